# SPDX-License-Identifier: Apache-2.0
"""``comcal diagnose``."""

from __future__ import annotations

from pathlib import Path

import click

EXIT_UNDECIDED = 5


@click.command("diagnose")
@click.argument("session", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="extended.yaml of the model that is assumed, instead of the session's robot as it is.",
)
@click.option(
    "--causes",
    metavar="LIST",
    default="",
    help="Look for these only, as payload,ft_bias [default: the whole catalogue].",
)
@click.option(
    "--drop", multiple=True, type=int, metavar="POSE", help="Leave a pose out. Repeatable."
)
@click.option(
    "--rerun",
    "engine",
    metavar="ENGINE",
    help="Run model and extended model again in pybullet, mujoco or builtin at the measured poses.",
)
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Of --rerun, for the same numbers again."
)
@click.option("--json", "as_json", is_flag=True, help="Print diagnosis.json, and nothing else.")
def diagnose_command(
    session: Path,
    model: Path | None,
    causes: str,
    drop: tuple[int, ...],
    engine: str | None,
    seed: int,
    as_json: bool,
) -> int:
    """Say what the model of the session in DIR gets wrong, and name the cause.

    Written are diagnosis.json, extended.yaml (the model to go on with, for record, solve and
    diagnose --model), report.html and used.csv in DIR/results/NNN; nothing is overwritten. Exit
    code 0: nothing is wrong, or what is wrong has a name; 3: the poses cannot be used; 5: causes
    are not told apart, or something is left that has no name.

    \b
    Example:
      comcal diagnose sessions/monday
    """
    from comcal.diagnose.diagnosis import Verdict
    from comcal.workflow.diagnose import diagnose_session

    names = [name.strip() for name in causes.split(",") if name.strip()]
    diagnosed = diagnose_session(
        session, model=model, causes=names, drop=drop, engine=engine, seed=seed
    )
    if as_json:
        click.echo(diagnosed.files[0].read_text("utf-8"), nl=False)
    else:
        from comcal.report.console import make_console, print_lines
        from comcal.report.diagnosis import print_diagnosis
        from comcal.report.rerun import rerun_lines

        console = make_console()
        if diagnosed.rerun is not None:
            print_lines(console, [*rerun_lines(diagnosed.rerun), ""])
        elif engine is not None:
            print_lines(console, ["nothing to run again: no cause was named", ""])
        print_diagnosis(console, diagnosed.diagnosis)
        for path in diagnosed.files:
            click.echo(f"wrote {path}")
    undecided = diagnosed.diagnosis.verdict in (Verdict.AMBIGUOUS, Verdict.UNEXPLAINED)
    return EXIT_UNDECIDED if undecided else 0
