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
    help="Write the session's URDF with new numbers in <inertial> (and in <origin> of joints whose "
    "length a model knows), every other byte as it was.",
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
    "--model",
    type=click.Path(path_type=Path),
    metavar="extended.yaml",
    help="Export this model: its result where the newest one was made with it, else the model "
    "alone, put on the session's URDF without fitting anything.",
)
@click.option(
    "--rest",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="F",
    help="Write what of the model no URDF can hold, for verify, record and solve --model.",
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
    model: Path | None,
    rest: Path | None,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Hand the newest result of the session in DIR back as a model: URDF, YAML, C.

    Of all models that reproduce everything the poses determine, single CoM components and sums,
    the one nearest to the URDF is written. What no pose speaks about keeps the number of the URDF.
    Each number says where it is from: measured, combination (a term of measured sums) or prior
    (the URDF). Nothing is ever overwritten.

    Of a result that was made with a model (solve --model), and of a model alone (--model), bodies
    and lengths go into the URDF; where the rest belongs is said.

    \b
    Examples:
      comcal export monday --dry-run
      comcal export monday --urdf calibrated.urdf --yaml calibrated.yaml
      comcal export monday --model extended.yaml --urdf corrected.urdf
    """
    from comcal.report.export_extension import ExtensionSummary
    from comcal.workflow.export import ExportOrder, export_session
    from comcal.workflow.known_model import read_model

    known = None if model is None else read_model(model)
    order = ExportOrder(urdf, yaml, c_folder, scale_masses, dry_run, known, rest)
    exported = export_session(session, order)
    if as_json:
        from comcal.report.export import exported_json
        from comcal.report.export_extension import extension_json

        alone = isinstance(exported, ExtensionSummary)
        content = extension_json(exported) if alone else exported_json(exported)
        click.echo(json.dumps(content, indent=1, allow_nan=False))
        return
    from comcal.report.console import make_console
    from comcal.report.export import print_exported
    from comcal.report.export_extension import print_extension

    if dry_run:
        # The difference alone on stdout, so that it can be piped into patch.
        click.echo(exported.diff, nl=False)
    console = make_console(stderr=dry_run)
    if isinstance(exported, ExtensionSummary):
        print_extension(console, exported)
    else:
        print_exported(console, exported)
    for path in exported.files:
        click.echo(f"wrote {path}")
    if not dry_run and not exported.files:
        click.echo("nothing written: give --urdf F, --yaml F or --c DIR; --dry-run shows the diff")
    elif urdf is not None and not dry_run:
        also = "" if rest is None else f" --model {rest}"
        what = f"comcal verify FRESH --urdf {urdf}{also}"
        click.echo(f"next: {what}   (FRESH: a session of other poses)")
