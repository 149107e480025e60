# SPDX-License-Identifier: Apache-2.0
"""``comcal derive``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from comcal.symbolic.program import Program
    from comcal.workflow.derive_session import SessionDerivation

EXIT_LIMIT = 5
FORMATS = ("text", "python", "c", "latex")
QUANTITIES = ("link-com", "total-com", "coefficients", "sigma", "rows")


@click.command("derive")
@click.option("--dof", type=int, metavar="N", help="The paper's chain with N links above the feet.")
@click.option(
    "--robot",
    type=click.Path(path_type=Path),
    metavar="ROBOT.yaml",
    help="The chain of your own robot, with its masses and lengths.",
)
@click.option("--base", metavar="LINK", help="Where the chain begins [default: the first foot].")
@click.option("--tip", metavar="LINK", help="Where it ends [default: the root link].")
@click.option(
    "--session",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Feed the generated Cramer function with a recorded session; compare with solve.",
)
@click.option(
    "--configurations",
    default="one-joint",
    show_default=True,
    metavar="one-joint|free|FILE",
    help="One joint bent at a time, any angles, or a YAML file of angles in numbers and names.",
)
@click.option(
    "--what",
    type=click.Choice(QUANTITIES),
    default="link-com",
    show_default=True,
    help="CoM of each link, total CoM of two poses, alpha .. delta, uncertainty of link CoMs, or "
    "the equations of one pose for your own least squares.",
)
@click.option(
    "--format",
    "language",
    type=click.Choice(FORMATS),
    default="text",
    show_default=True,
    help="Text, a numpy function, a C99 function with a self-test, or a LaTeX document.",
)
@click.option(
    "--check",
    type=click.Path(path_type=Path),
    metavar="FILE.yaml",
    help="Compare a formula written by hand with the derivation; name the term that is wrong.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; an existing one is never overwritten [default: standard output].",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else.")
def derive_command(
    dof: int | None,
    robot: Path | None,
    base: str | None,
    tip: str | None,
    session: Path | None,
    configurations: str,
    what: str,
    language: str,
    check: Path | None,
    output: Path | None,
    as_json: bool,
) -> int:
    """Derive the formulas of the calibration, for the paper's chain or for your own robot.

    Link CoMs come by Cramer's rule from the total CoM of n shapes, as short steps instead of one
    huge formula: the text shows them, Python and C compute them. Bending one joint at a time gives
    a closed form for any number of links; free configurations are for up to 12. Where joints do
    not all turn about one axis, or slide, the first moments that static data can see come in place
    of link CoMs, by the same two routes (free: up to 4 joints); what they cannot see is named.

    FILE holds `format: comcal-configurations/1` and `configurations:`, one per line, the absolute
    pitch of every segment from the ankle up, or for a spatial chain the position of every joint
    from the base: `c: [0, theta_c]` or `c: [0, 30 deg]`.

    \b
    Examples:
      comcal derive --dof 3
      comcal derive --dof 6 --configurations free --format c -o link_coms.c
      comcal derive --robot robot.yaml --base l_thigh --tip pelvis --format c
      comcal derive --check equation.yaml
    """
    given = [x for x in (dof, robot, session, check) if x is not None]
    if len(given) > 1:
        raise click.UsageError("give one of --dof, --robot, --session and --check")
    if check is not None:
        return _check(check, as_json)
    if (base or tip) and robot is None:
        raise click.UsageError("--base and --tip name links of a --robot")
    if session is not None:
        _feed(session, language, output, as_json)
        return 0
    if not given and what in {"link-com", "sigma", "rows"}:
        raise click.UsageError("give --dof N or --robot ROBOT.yaml")
    # Imported late: sympy takes half a second.
    from comcal.workflow.derive import PRINTERS, DeriveOrder, What, derive, write_new

    program = derive(DeriveOrder(What(what), dof, robot, base, tip, configurations))
    text = PRINTERS[language](program)
    if output is not None:
        write_new(output, text)
    if as_json:
        click.echo(json.dumps(_as_json(program, what, language, text, output), indent=1))
    elif output is not None:
        click.echo(f"wrote {output}")
    else:
        click.echo(text, nl=False)
    return 0


def _check(path: Path, as_json: bool) -> int:
    """Compare a hand-written formula; a fault found is like a limit that is not met."""
    from comcal.report.formula_check import formula_report_lines
    from comcal.workflow.check_formula import check_formula

    report = check_formula(path)
    lines = formula_report_lines(report)
    if as_json:
        found = {"format": "comcal-formula-check/1", "agrees": report.agrees, "report": lines}
        click.echo(json.dumps(found, indent=1))
    else:
        for line in lines:
            click.echo(line)
    return 0 if report.agrees else EXIT_LIMIT


def _as_json(
    program: Program, what: str, language: str, text: str, output: Path | None
) -> dict[str, object]:
    return {
        "format": "comcal-derivation/1",
        "what": what,
        "title": program.title,
        "function": program.name,
        "inputs": [
            {"name": q.name, "shape": list(q.shape), "unit": q.unit, "meaning": q.meaning}
            for q in program.inputs
        ],
        "outputs": [
            {
                "name": o.name,
                "shape": [len(o.values)] if o.is_list else [],
                "unit": o.unit,
                "meaning": o.meaning,
            }
            for o in program.outputs
        ],
        "steps": len(program.steps),
        "language": language,
        "file": None if output is None else str(output),
        "text": text,
    }


def _feed(session: Path, language: str, output: Path | None, as_json: bool) -> None:
    """Evaluate the generated function with a session's CoMs and print it beside solve's answer."""
    from comcal.report.console import make_console, print_lines, print_table
    from comcal.workflow.derive import PRINTERS, write_new
    from comcal.workflow.derive_session import derive_session

    found = derive_session(session)
    if output is not None:
        write_new(output, PRINTERS[language](found.program))
    if as_json:
        click.echo(json.dumps(_session_as_json(found), indent=1, allow_nan=False))
        return
    console = make_console()
    names = ", ".join(found.configurations)
    print_lines(console, [f"Cramer's rule, generated for configurations {names} [mm]", ""])
    rows = [
        (name, *(f"{1e3 * value:.6f}" for value in (*generated, *solved)))
        for name, generated, solved in zip(
            found.segments, found.generated, found.solved, strict=True
        )
    ]
    print_table(console, rows, ("segment", "r generated", "l generated", "r solve", "l solve"))
    print_lines(console, ["", f"largest difference {found.difference:.1e} m"])
    if output is not None:
        click.echo(f"wrote {output}")


def _session_as_json(found: SessionDerivation) -> dict[str, object]:
    return {
        "format": "comcal-derivation-session/1",
        "segments": list(found.segments),
        "configurations": list(found.configurations),
        "inputs": {name: value.tolist() for name, value in found.inputs.items()},
        "generated": {"r": found.generated[:, 0].tolist(), "l": found.generated[:, 1].tolist()},
        "solved": {"r": found.solved[:, 0].tolist(), "l": found.solved[:, 1].tolist()},
        "difference": found.difference,
    }
