# SPDX-License-Identifier: Apache-2.0
"""``comcal generate``."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command("generate")
@click.argument("name", metavar="NAME")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for robot.yaml, the URDF and plan.csv; existing files are never overwritten.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="A parameter of the robot in SI units, as r_b=0.01 or roll_joints=true. Repeatable.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the written files as JSON.")
def generate_command(name: str, output: Path, settings: tuple[str, ...], as_json: bool) -> None:
    """Write a generated robot: table1 (Muscolo 2017, Table 1) or biped14 (64 kg, 14 joints).

    All masses, lengths and CoMs of the robot are parameters; a wrong name is answered with the
    names that exist.

    \b
    Example:
      comcal generate table1 -o robot --set r_b=0.01 --set r_c=-0.02
    """
    from comcal.workflow.robots import parameters_of, robot_generator

    robot_yaml = robot_generator(name)(output, **parameters_of(settings))
    files = sorted(path for path in output.iterdir() if path.is_file())
    if as_json:
        click.echo(json.dumps({"robot_yaml": str(robot_yaml), "files": [str(f) for f in files]}))
        return
    for path in files:
        click.echo(f"wrote {path}")
    click.echo(f"next: comcal record {robot_yaml} -s SESSION --source builtin")
