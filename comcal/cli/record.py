# SPDX-License-Identifier: Apache-2.0
"""``comcal record``."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import click

from comcal.cli.grouped import losses_text
from comcal.measure.both_sides import BOTH
from comcal.measure.operator import Nobody
from comcal.measure.source import SourceStatus
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
    help="What measures the robot; pybullet, mujoco and builtin simulate it and move it, too.",
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
    metavar="S",
    help="Seconds to wait for such a window after moving "
    f"[default: {DEFAULT.timeout:g}; as long as it takes for a person].",
)
@click.option(
    "--arrival",
    type=click.FloatRange(min=0, min_open=True),
    default=DEFAULT.arrival,
    show_default=True,
    metavar="RAD",
    help="Largest distance of a joint from its planned position, in rad (or m).",
)
@click.option(
    "--approach",
    type=click.Choice([BOTH]),
    help="Approach every pose from both sides of every joint that moves to it: pose N becomes "
    "2 N and 2 N + 1.",
)
@click.option(
    "--via",
    type=click.FloatRange(min=0, max=20, min_open=True),
    default=3.0,
    show_default=True,
    metavar="DEG",
    help="How far beyond its place a joint goes first, to arrive from a certain side.",
)
@click.option(
    "--commander",
    default="",
    metavar="NAME[:ARG]",
    help="Let a program move the robot, not you [default: you do]. It is asked for consent first.",
)
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    default=0.1,
    show_default=True,
    metavar="RAD/S",
    help="Fastest joint of a commanded robot; 0.1 rad/s are 6 degrees per second.",
)
@click.option("--yes", is_flag=True, help="Consent that a commander moves the robot.")
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
    timeout: float | None,
    arrival: float,
    approach: str | None,
    via: float,
    commander: str,
    speed: float,
    yes: bool,
    as_json: bool,
) -> None:
    """Drive the poses of a plan and record each one once the robot stands still.

    Still means: the centre of pressure has a standard deviation below --still-sd over
    --still-window, and has moved by less than that during the last second. A pose that does not
    become still within --timeout is tried once more, then left out and named at the end.

    A source that only measures leaves the moving to you: the terminal shows how far every joint
    is from the pose wanted, beeps when the pose is recorded, and shows the next one. Keys: s skips
    a pose, r measures the last one again, q saves and quits. With --commander a program moves the
    robot, slowly, to planned poses only; space, q or Ctrl-C stops it and ends the recording.

    Type the same command again to go on after an interruption: finished poses are kept.

    \b
    Examples:
      comcal record robot.yaml -s monday --source pybullet --seed 1
      comcal record robot.yaml -s monday --source can --approach both
    """
    # Imported late, so that --help does not wait for the engines of half the program.
    from comcal.cli.consent import ask_on_terminal
    from comcal.cli.keys import HELP, HELP_COMMANDED, terminal_operator
    from comcal.cli.record_progress import shown_progress
    from comcal.robot.changes_text import parse_change
    from comcal.robot.changes_yaml import read_extension
    from comcal.workflow.commanders import CommanderOrder
    from comcal.workflow.record import RecordOrder, record_session
    from comcal.workflow.sealed import truth_path

    known = read_extension(model) if model is not None else ()
    hidden = (*(entry.change for entry in known), *(parse_change(text) for text in effects))
    operator = terminal_operator()
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
            settle=max(DEFAULT.settle, still_window),
            arrival=arrival,
        ),
        changes=hidden,
        argv=tuple(sys.argv[1:]),
        timeout=timeout,
        commander=CommanderOrder(
            name=commander,
            speed=speed,
            consent=(lambda _: True) if yes else ask_on_terminal,
            operator=operator,
        ),
        approach=approach or "",
        via=math.radians(via),
    )
    keys = HELP_COMMANDED if commander else HELP
    with shown_progress(sys.stderr, "" if isinstance(operator, Nobody) else keys) as show:
        outcome = record_session(order, show)
    summary = outcome.summary
    for skipped in summary.skipped:
        if skipped.by_operator:
            continue
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
                    **({} if summary.status is None else {"lost": dict(summary.status.lost)}),
                },
                indent=2,
            )
        )
        return
    seed_text = "" if outcome.seed is None else f", seed {outcome.seed}"
    click.echo(f"source {source} ({outcome.engine}){seed_text}")
    count = len(summary.recorded) + len(summary.before)
    kept = f", {len(summary.before)} of them before" if summary.before else ""
    click.echo(f"{count} poses in {outcome.session.poses_csv}{kept}")
    left_out = [str(s.pose) for s in summary.skipped if s.by_operator]
    if left_out:
        click.echo(f"left out by you: {', '.join(left_out)}; the same command asks for them again")
    if summary.status is not None:
        click.echo(_losses(summary.status))
        for note in summary.status.notes:
            click.echo(f"note: {note}", err=True)
    if hidden:
        told = "1 effect is" if len(hidden) == 1 else f"{len(hidden)} effects are"
        click.echo(f"{told} hidden in it: {truth_path(directory).name}")
    click.echo(f"next: comcal solve {directory}")


def _losses(status: SourceStatus) -> str:
    """Return the line about what the source lost."""
    lost = losses_text(status)
    return f"lost on the way: {lost}" if lost else "nothing was lost on the way"
