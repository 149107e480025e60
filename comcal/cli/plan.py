# SPDX-License-Identifier: Apache-2.0
"""``comcal plan``."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import click


@click.command("plan")
@click.argument("robot", metavar="ROBOT.yaml", type=click.Path(path_type=Path))
@click.option(
    "-n", "--n", "count", type=click.IntRange(min=1), default=40, show_default=True, metavar="N",
    help="Number of poses.",
)  # fmt: skip
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("plan.csv"),
    show_default=True,
    help="File to write; an existing one is never overwritten.",
)
@click.option(
    "--support",
    metavar="LIST",
    default="",
    help="Supports to use, as double,left,right [default: both feet and every single foot].",
)
@click.option(
    "--goal",
    type=click.Choice(["dopt", "com_z", "worst"]),
    default="dopt",
    show_default=True,
    help="Smallest confidence ellipsoid, best height of the total CoM, or best worst combination.",
)
@click.option(
    "--improve",
    type=click.Path(path_type=Path),
    metavar="SESSION",
    help="Plan the poses that help most given those of this session.",
)
@click.option(
    "--avoid",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="CSV of poses not to be near (q.<joint> columns), or YAML with joint ranges that must "
    "not hold at once: `avoid: [{l_knee: [1, 2], r_knee: [1, 2]}]`.",
)
@click.option(
    "--margin",
    type=click.FloatRange(min=0),
    default=15.0,
    show_default=True,
    metavar="MM",
    help="Least distance of the CoM from the edges of the support polygon, in mm.",
)
@click.option(
    "--range",
    "joint_range",
    type=click.FloatRange(min=0, min_open=True, max=1),
    default=0.95,
    show_default=True,
    metavar="SHARE",
    help="Middle share of every joint's range that may be used.",
)
@click.option("--masses", is_flag=True, help="Plan for the mass of every link, too.")
@click.option("--seed", type=click.IntRange(min=0), help="Of the random candidates; printed.")
@click.option("--json", "as_json", is_flag=True, help="Print the forecast as JSON, nothing else.")
def plan_command(
    robot: Path,
    count: int,
    output: Path,
    support: str,
    goal: str,
    improve: Path | None,
    avoid: Path | None,
    margin: float,
    joint_range: float,
    masses: bool,
    seed: int | None,
    as_json: bool,
) -> None:
    """Choose N poses that tell most about the robot, and say how much, before it moves.

    Every pose is inside the joint limits, balanced on a level floor, held by the motors and free of
    self-collision; both feet stay where they stand at q = 0. Predicted are the +/- mm of every link
    and of the total CoM, with the noise of robot.yaml.

    Nobody checks the way from pose to pose: the first time, watch the robot.

    \b
    Example:
      comcal plan robot.yaml -n 40 -o plan.csv
    """
    from comcal.plan.design import Goal
    from comcal.report.console import make_console
    from comcal.report.plan import plan_json, print_plan
    from comcal.workflow.plan import PlanOrder, plan_poses

    order = PlanOrder(
        robot_yaml=robot,
        output=output,
        n=count,
        supports=tuple(dict.fromkeys(s.strip() for s in support.split(",") if s.strip())),
        goal=Goal(goal),
        margin=1e-3 * margin,
        joint_range=joint_range,
        seed=seed,
        improve=improve,
        avoid=avoid,
        free_masses=masses,
    )
    with _shown_progress() as show:
        planned = plan_poses(order, show)
    if as_json:
        result = plan_json(planned) | {"plan": str(output), "goal": goal}
        click.echo(json.dumps(result, indent=1, allow_nan=False))
        return
    print_plan(
        make_console(),
        planned,
        robot=planned.robot.name,
        goal=goal,
        margin=order.margin,
        joint_range=joint_range,
    )
    click.echo(f"wrote {output}")
    click.echo(f"next: comcal record {robot} -s SESSION --poses {output} --source NAME")


@contextmanager
def _shown_progress() -> Generator[Callable[[str, int, int], None], None, None]:
    """Yield a function that shows how far the search is; on a terminal only."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from comcal.plan.candidates import silent
    from comcal.report.console import make_console

    console = make_console(stderr=True, file=sys.stderr)
    if not console.is_terminal:
        yield silent
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task("candidates", total=None)

        def show(what: str, done: int, total: int) -> None:
            progress.update(bar, description=what, completed=done, total=total)

        yield show
