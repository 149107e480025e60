# SPDX-License-Identifier: Apache-2.0
"""``comcal record``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from comcal.measure.still import StillCriterion

DEFAULT = StillCriterion()


@click.command("record")
@click.argument("robot", metavar="ROBOT.yaml", type=click.Path(path_type=Path))
@click.option(
    "-s",
    "--session",
    "directory",
    required=True,
    type=click.Path(path_type=Path),
    help="Session folder: a new one, or one to go on with.",
)
@click.option(
    "--source",
    required=True,
    metavar="NAME[:ARG]",
    help="What measures and moves the robot: pybullet, mujoco or builtin.",
)
@click.option(
    "--poses",
    "plan",
    type=click.Path(path_type=Path),
    help="The planned poses [default: plan.csv beside ROBOT].",
)
@click.option(
    "--redo",
    type=int,
    multiple=True,
    metavar="N",
    help="Measure pose N again, under a new number; its old row stays, out of use. Repeatable.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Master seed of a simulated source.")
@click.option("--no-noise", is_flag=True, help="Simulated sources: the engine's own values.")
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME@TARGET:KEY=VALUE,...",
    help="Hide an effect in a simulated robot, e.g. payload@torso:mass=5,com_z=0.2. The truth goes "
    "to DIR.truth.yaml beside the session. Repeatable.",
)
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="extended.yaml",
    help="Simulate the robot with these effects.",
)
@click.option(
    "--still-sd",
    type=click.FloatRange(min=0, min_open=True),
    default=1e3 * DEFAULT.cop_sd,
    show_default=True,
    metavar="MM",
    help="Largest standard deviation of the centre of pressure within the window, in mm.",
)
@click.option(
    "--still-window",
    type=click.FloatRange(min=0, min_open=True),
    default=DEFAULT.window,
    show_default=True,
    metavar="S",
    help=f"Seconds that are averaged, at least {DEFAULT.min_samples} samples.",
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=DEFAULT.timeout,
    show_default=True,
    metavar="S",
    help="Seconds to wait for such a window after moving.",
)
@click.option(
    "--arrival",
    type=click.FloatRange(min=0, min_open=True),
    default=DEFAULT.arrival,
    show_default=True,
    metavar="RAD",
    help="Largest distance of a joint from its planned position, in rad (or m).",
)
@click.option("--json", "as_json", is_flag=True, help="Print the outcome as JSON, nothing else.")
def record_command(
    robot: Path,
    directory: Path,
    source: str,
    plan: Path | None,
    redo: tuple[int, ...],
    seed: int | None,
    no_noise: bool,
    effects: tuple[str, ...],
    model: Path | None,
    still_sd: float,
    still_window: float,
    timeout: float,
    arrival: float,
    as_json: bool,
) -> None:
    """Drive the poses of a plan and record each one once the robot stands still.

    Still means: the centre of pressure has a standard deviation below --still-sd over
    --still-window, and has moved by less than that during the last second. A pose that does not
    become still within --timeout is tried once more, then left out and named at the end.

    Type the same command again to go on after an interruption: finished poses are kept.

    \b
    Example:
      comcal record robot.yaml -s monday --source pybullet --seed 1
    """
    # Imported late, so that --help does not wait for the engines of half the program.
    from comcal.cli.record_progress import shown_progress
    from comcal.robot.changes_text import parse_change
    from comcal.robot.changes_yaml import read_extension
    from comcal.workflow.record import RecordOrder, record_session
    from comcal.workflow.sealed import truth_path

    known = read_extension(model) if model is not None else ()
    hidden = (*(entry.change for entry in known), *(parse_change(text) for text in effects))
    order = RecordOrder(
        robot_yaml=robot,
        directory=directory,
        source=source,
        plan=plan,
        redo=redo,
        seed=seed,
        noise=not no_noise,
        criterion=StillCriterion(
            cop_sd=1e-3 * still_sd,
            drift=1e-3 * still_sd,
            window=still_window,
            timeout=timeout,
            settle=max(DEFAULT.settle, still_window),
            arrival=arrival,
        ),
        changes=hidden,
        argv=tuple(sys.argv[1:]),
    )
    with shown_progress(sys.stderr) as show:
        outcome = record_session(order, show)
    summary = outcome.summary
    for skipped in summary.skipped:
        click.echo(
            f"note: pose {skipped.pose} never became still and is left out: {skipped.reason}; "
            "the same command tries it again",
            err=True,
        )
    if as_json:
        click.echo(
            json.dumps(
                {
                    "format": "comcal-recording/1",
                    "session": str(outcome.session.directory),
                    "poses_csv": str(outcome.session.poses_csv),
                    "source": source,
                    "engine": outcome.engine,
                    "seed": outcome.seed,
                    "recorded": list(summary.recorded),
                    "before": list(summary.before),
                    "skipped": [{"pose": s.pose, "reason": s.reason} for s in summary.skipped],
                    "superseded": list(outcome.session.superseded()),
                },
                indent=2,
            )
        )
        return
    click.echo(f"source {source} ({outcome.engine}), seed {outcome.seed}")
    count = len(summary.recorded) + len(summary.before)
    kept = f", {len(summary.before)} of them before" if summary.before else ""
    click.echo(f"{count} poses in {outcome.session.poses_csv}{kept}")
    if hidden:
        click.echo(f"{len(hidden)} effects are hidden in it: {truth_path(directory).name}")
    click.echo(f"next: comcal solve {directory}")
