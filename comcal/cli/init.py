# SPDX-License-Identifier: Apache-2.0
"""``comcal init``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from comcal.robot.guess import Guess


@click.command("init")
@click.argument("robot", metavar="ROBOT.yaml", type=click.Path(path_type=Path))
@click.option(
    "--urdf",
    required=True,
    type=click.Path(path_type=Path),
    metavar="F",
    help="The robot's URDF; xacro has to be expanded first.",
)
@click.option("--json", "as_json", is_flag=True, help="Print what was guessed as JSON.")
def init_command(robot: Path, urdf: Path, as_json: bool) -> None:
    """Write a commented ROBOT.yaml from a URDF.

    Feet, their sensors and soles, and the IMU are guessed from names and geometry, each guess with
    its reason beside it; motors are left as lines to fill in. An existing file is never
    overwritten.

    \b
    Example:
      comcal init robot.yaml --urdf robot.urdf
    """
    from comcal.workflow.init import init_robot

    guess = init_robot(robot, urdf)
    if as_json:
        click.echo(json.dumps({"robot_yaml": str(robot), **_as_json(guess)}, indent=1))
        return
    click.echo(f"wrote {robot}")
    for found in guess.feet:
        foot = found.foot
        click.echo(f"foot {foot.name}: link {foot.link}; {found.why_link}")
        click.echo(f"  sensor at {found.sensor.joint}; {found.why_sensor}")
        click.echo(f"  sole {found.why_sole}; ankle {foot.ankle or 'not found'}")
    if not guess.feet:
        click.echo("no legs were found: fill in `sensors` and `feet`")
    if guess.other_sensors:
        click.echo(f"other joints that look like sensors: {', '.join(guess.other_sensors)}")
    click.echo(f"IMU: {guess.imu_link or 'none found'}")
    click.echo("every guess is to be checked; motors are to be filled in if currents are used")
    click.echo(f"next: comcal check {robot}")


def _as_json(guess: Guess) -> dict[str, object]:
    return {
        "feet": [
            {
                "name": found.foot.name,
                "link": found.foot.link,
                "sensor_joint": found.sensor.joint,
                "ankle": found.foot.ankle,
                "sole": None if found.foot.sole is None else found.foot.sole.tolist(),
                "reasons": [found.why_link, found.why_sensor, found.why_sole],
            }
            for found in guess.feet
        ],
        "imu": guess.imu_link,
        "other_sensors": list(guess.other_sensors),
    }
