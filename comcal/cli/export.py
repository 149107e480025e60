# SPDX-License-Identifier: Apache-2.0
"""``comcal export``."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command("export")
@click.argument("session", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--urdf",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="F",
    help="Write the session's URDF with new numbers in <inertial>, every other byte as it was.",
)
@click.option(
    "--yaml",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="F",
    help="Write mass, CoM, sigma, frame and provenance of every link.",
)
@click.option(
    "--c",
    "c_folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write CoM and Jacobian of the calibrated robot as dependency-free C99 into a folder.",
)
@click.option(
    "--scale-masses",
    is_flag=True,
    help="Multiply all masses and inertias by one factor, so that the sensors carry what they "
    "measured; by default masses stay.",
)
@click.option(
    "--dry-run", is_flag=True, help="Print the difference between the URDFs, and write nothing."
)
@click.option("--json", "as_json", is_flag=True, help="Print the model as JSON, nothing else.")
def export_command(
    session: Path,
    urdf: Path | None,
    yaml: Path | None,
    c_folder: Path | None,
    scale_masses: bool,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Hand the newest result of the session in DIR back as a model: URDF, YAML, C.

    Of all models that reproduce everything the poses determine, single CoM components and sums,
    the one nearest to the URDF is written. What no pose speaks about keeps the number of the URDF.
    Each number says where it is from: measured, combination (a term of measured sums) or prior
    (the URDF). Nothing is ever overwritten.

    \b
    Examples:
      comcal export monday --dry-run
      comcal export monday --urdf calibrated.urdf --yaml calibrated.yaml
    """
    from comcal.workflow.export import ExportOrder, export_session

    exported = export_session(session, ExportOrder(urdf, yaml, c_folder, scale_masses, dry_run))
    if as_json:
        from comcal.report.export import exported_json

        click.echo(json.dumps(exported_json(exported), indent=1, allow_nan=False))
        return
    from comcal.report.console import make_console
    from comcal.report.export import print_exported

    if dry_run:
        # The difference alone on stdout, so that it can be piped into patch.
        click.echo(exported.diff, nl=False)
    print_exported(make_console(stderr=dry_run), exported)
    for path in exported.files:
        click.echo(f"wrote {path}")
    if not dry_run and not exported.files:
        click.echo("nothing written: give --urdf F, --yaml F or --c DIR; --dry-run shows the diff")
    elif urdf is not None and not dry_run:
        click.echo(f"next: comcal verify FRESH --urdf {urdf}   (FRESH: a session of other poses)")
