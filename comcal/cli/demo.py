# SPDX-License-Identifier: Apache-2.0
"""``comcal demo``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

EXIT_UNUSABLE, EXIT_LIMIT = 3, 5


@click.command("demo")
@click.option(
    "--robot",
    default="table1",
    show_default=True,
    help="Generated robot: table1 (Muscolo 2017) or biped14 (64 kg, 14 joints).",
)
@click.option("--source", help="pybullet, mujoco or builtin [default: the best one installed].")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the sensor noise [default: new].")
@click.option(
    "-o",
    "--output",
    default=".",
    type=click.Path(path_type=Path, file_okay=False),
    show_default="this folder",
    help="Folder in which the demo's own folder is made.",
)
@click.option("--json", "as_json", is_flag=True, help="Print result.json, and nothing else.")
def demo_command(
    robot: str, source: str | None, seed: int | None, output: Path, as_json: bool
) -> int:
    """Calibrate a simulated biped: generate it, measure it, solve, judge.

    Takes a few seconds and writes into a new folder comcal-demo (nothing is overwritten). Exit
    code 5 when a limit is not met.

    \b
    Example:
      comcal demo --seed 1
    """
    from comcal.cli.record_progress import shown_progress
    from comcal.identify.calibration import Verdict
    from comcal.report.calibration import print_calibration
    from comcal.report.console import make_console
    from comcal.workflow.demo import EngineChoice, run_demo

    console = make_console()

    def say(choice: EngineChoice) -> None:
        if not as_json:
            console.print(f"engine: {choice.source}, because {choice.why}")

    with shown_progress(sys.stderr) as show:
        demo = run_demo(output, robot, source, seed, say, show)
    calibration = demo.solved.calibration
    if as_json:
        click.echo(demo.solved.files[0].read_text("utf-8"), nl=False)
    else:
        poses = len(calibration.table)
        console.print(f"robot: {calibration.robot.name}, {poses} poses, seed {demo.seed}")
        print_calibration(console, calibration, full=False)
        console.print()
        for path in (demo.robot_yaml, demo.solved.session.poses_csv, *demo.solved.files):
            click.echo(f"wrote {path}")
        click.echo(f"next: comcal solve {demo.solved.session.directory}   (everything, in full)")
        click.echo(f"      comcal check {demo.robot_yaml}   (what a robot description holds)")
    exits = {Verdict.NOT_IDENTIFIABLE: EXIT_UNUSABLE, Verdict.FAILED: EXIT_LIMIT}
    return exits.get(calibration.verdict, 0)
