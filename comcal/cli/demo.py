# SPDX-License-Identifier: Apache-2.0
"""``comcal demo``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

EXIT_NOT_FOUND = 5


@click.command("demo")
@click.option(
    "--robot",
    default="biped14",
    show_default=True,
    help="Generated robot: biped14 (64 kg, 14 joints) or table1 (Muscolo 2017; planar, so that "
    "some faults cannot be told apart).",
)
@click.option("--source", help="pybullet, mujoco or builtin [default: the best one installed].")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed of the fault that is hidden and of the sensor noise [default: new].",
)
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="none|EFFECT",
    help="Hide this instead, as for record: payload@torso:mass=3,com_x=0.1. Repeatable. "
    "none: hide nothing.",
)
@click.option(
    "-o",
    "--output",
    default=".",
    type=click.Path(path_type=Path, file_okay=False),
    show_default="this folder",
    help="Folder in which the demo's own folder is made.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the outcome as JSON, nothing else.")
def demo_command(
    robot: str,
    source: str | None,
    seed: int | None,
    effects: tuple[str, ...],
    output: Path,
    as_json: bool,
) -> int:
    """Hide a fault in a simulated biped; measure it, name the fault, mend the model, judge.

    Takes about ten seconds and writes into a new folder comcal-demo (nothing is overwritten). What
    is hidden stands in session.truth.yaml beside the session, and is read for the last line only.
    Exit code 0: found right; 5: not.

    \b
    Example:
      comcal demo --seed 1
    """
    from comcal.cli.record_progress import shown_progress
    from comcal.report.console import make_console, print_lines
    from comcal.report.demo import FORMAT, demo_json, print_demo
    from comcal.report.demo_truth import hidden_line
    from comcal.workflow.demo import Begun, DemoOrder, run_demo

    console = make_console()

    def say(begun: Begun) -> None:
        if as_json:
            return
        choice, tree = begun.choice, begun.robot.tree
        console.print(f"engine: {choice.source}, because {choice.why}")
        facts = f"{tree.total_mass:.1f} kg, {len(tree.joint_names)} joints, {begun.poses} poses"
        console.print(f"robot: {begun.robot.name}, {facts}, seed {begun.seed}")
        hidden = "what --effect says" if effects else "a fault, drawn with the seed"
        console.print(f"hidden: {hidden}; nobody looks at it before the last line")

    with shown_progress(sys.stderr) as show:
        demo = run_demo(DemoOrder(output, robot, source, seed, effects), say, show)
    if as_json:
        content = {
            "format": FORMAT,
            "engine": demo.begun.choice.source,
            "robot": demo.begun.robot.name,
            "seed": demo.begun.seed,
            "session": str(demo.session.directory),
            **demo_json(demo.story, demo.judgement),
        }
        click.echo(json.dumps(content, indent=1, allow_nan=False))
    else:
        print_demo(console, demo.story)
        click.echo(f"wrote {demo.story.page}   (in full: comcal diagnose {demo.session.directory})")
        print_lines(console, [hidden_line(demo.judgement)], style="bold")
    return 0 if demo.judgement.is_right else EXIT_NOT_FOUND
