# SPDX-License-Identifier: Apache-2.0
"""``comcal solve``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from comcal.cli.pose_list import pose_numbers

if TYPE_CHECKING:
    from rich.console import Console

    from comcal.identify.calibration import Calibration

EXIT_UNUSABLE, EXIT_LIMIT = 3, 5


@click.command("solve")
@click.argument("session", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--method",
    type=click.Choice(["both", "cramer", "lstsq"]),
    default="both",
    show_default=True,
    help="The paper's route (twins, Cramer's rule), all data at once, or both side by side.",
)
@click.option(
    "--as-published",
    is_flag=True,
    help="Show beside it what the formulas of Muscolo 2017 give as printed, fault by fault.",
)
@click.option("--masses", is_flag=True, help="Try to refit the link masses too, and judge that.")
@click.option(
    "--no-currents", is_flag=True, help="Leave motor currents and joint torques out of it."
)
@click.option(
    "--free-masses",
    is_flag=True,
    help="Look for the mass of every link as well; other sensors than the feet's then count too.",
)
@click.option(
    "--unknown-tares",
    is_flag=True,
    help="Find the offsets of the force sensors together with the CoMs.",
)
@click.option(
    "--prior",
    type=float,
    metavar="STRENGTH",
    help="Show beside it what data and CAD say together; 1 takes robot.yaml: tolerances as stated.",
)
@click.option(
    "--consistent",
    is_flag=True,
    help="Show beside it the nearest robot with positive masses and CoMs inside their links.",
)
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="extended.yaml",
    help="Known changes, as diagnose writes them: robot and readings are corrected by them first.",
)
@click.option(
    "--drop", multiple=True, type=int, metavar="POSE", help="Leave a pose out. Repeatable."
)
@click.option(
    "--held-out",
    metavar="POSES",
    default="",
    help="Poses to predict instead of fitting them, as 4,7,31-60; without it, a robot with a URDF "
    "is cross-validated.",
)
@click.option("--json", "as_json", is_flag=True, help="Print result.json, and nothing else.")
def solve_command(
    session: Path,
    method: str,
    as_published: bool,
    masses: bool,
    no_currents: bool,
    free_masses: bool,
    unknown_tares: bool,
    prior: float | None,
    consistent: bool,
    model: Path | None,
    drop: tuple[int, ...],
    held_out: str,
    as_json: bool,
) -> int:
    """Solve the session in DIR: coefficients, total CoM, CoM of each link, intervals, verdict.

    DIR holds robot.yaml, its URDF and poses.csv: made by record or import, or by hand. Written are
    DIR/results/NNN/result.json and used.csv; nothing is overwritten. Exit code 0: passed, or no
    limits are set; 3: the poses do not determine any link, or no robot is physically possible; 5:
    a limit is not met. What --prior and --consistent assume is marked, and never exported; what
    --model says is part of the robot, and is.

    \b
    Example:
      comcal solve sessions/monday
    """
    from comcal.identify.calibration import Method, Verdict
    from comcal.identify.scope import Scope
    from comcal.report.console import make_console
    from comcal.workflow.calibrate import is_chain, solve_session
    from comcal.workflow.known_model import read_model

    if as_json and (as_published or masses):
        word = "--as-published" if as_published else "--masses"
        raise click.UsageError(f"{word} is text beside the result; leave out --json")
    if is_chain(session):
        from comcal.cli.solve_chain import solve_chain

        assumed = prior is not None or consistent
        other = free_masses or unknown_tares or assumed or model is not None
        if as_published or masses or other or method != "both":
            raise click.UsageError(
                "--as-published, --masses, --free-masses, --unknown-tares, --prior, --consistent, "
                "--model and --method need a robot with a URDF"
            )
        return solve_chain(session, drop, held_out, as_json)
    scope = Scope(not no_currents, free_masses, unknown_tares)
    solved = solve_session(
        session,
        Method(method),
        drop,
        scope,
        strength=prior,
        consistent=consistent,
        held_out=pose_numbers(held_out, "--held-out"),
        model=None if model is None else read_model(model),
    )
    calibration = solved.calibration
    if as_json:
        click.echo(json.dumps(json.loads(solved.files[0].read_text("utf-8")), indent=1))
    else:
        from comcal.report.calibration import print_calibration

        console = make_console()
        if as_published:
            _print_published(console, calibration)
        if masses:
            _print_masses(console, calibration)
        print_calibration(console, calibration)
        for path in solved.files:
            click.echo(f"wrote {path}")
    if calibration.consistent is not None and calibration.consistent.theta is None:
        return EXIT_UNUSABLE
    exits = {Verdict.NOT_IDENTIFIABLE: EXIT_UNUSABLE, Verdict.FAILED: EXIT_LIMIT}
    return exits.get(calibration.verdict, 0)


def _print_published(console: Console, calibration: Calibration) -> None:
    from comcal.report.console import print_lines
    from comcal.report.published import (
        nominal_row,
        published_heading,
        published_name,
        published_row,
    )
    from comcal.workflow.published import NotComparable, published_comparison

    found = published_comparison(calibration.robot, calibration.table)
    if isinstance(found, NotComparable):
        reason = f"as published: the session does not hold the paper's poses: {found.reason}"
        print_lines(console, [reason, ""])
        return
    lines = [*published_heading(found.poses, found.rank), nominal_row(found.nominal)]
    lines += [published_row(v.faults, v.factor, v.result) for v in found.variants]
    lines += [
        f"note: {published_name(v.faults, v.factor)}: {v.reason}"
        for v in found.variants
        if v.reason
    ]
    lines += [f"note: {note}" for note in found.notes]
    lines.append(
        "note: one noise enters every line, so compare lines; the sigma of the corrected one is "
        "that of Cramer's rule below"
    )
    print_lines(console, [*lines, ""])


def _print_masses(console: Console, calibration: Calibration) -> None:
    from comcal.identify.mass_refit import refit_masses
    from comcal.report.console import print_lines
    from comcal.report.masses import masses_lines

    lines = masses_lines(refit_masses(calibration.robot, calibration.table))
    print_lines(console, [*lines, ""])
