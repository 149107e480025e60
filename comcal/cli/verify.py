# SPDX-License-Identifier: Apache-2.0
"""``comcal verify``."""

from __future__ import annotations

import json
from pathlib import Path

import click

EXIT_LIMIT = 5


@click.command("verify")
@click.argument("session", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--urdf",
    required=True,
    type=click.Path(path_type=Path),
    metavar="F",
    help="The model to be judged: the same links and joints as the session's robot.",
)
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="rest.yaml",
    help="Known changes that the URDF cannot hold, as export writes them with --rest.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, nothing else.")
def verify_command(session: Path, urdf: Path, model: Path | None, as_json: bool) -> int:
    """Predict the poses of the session in DIR with a given URDF; nothing is fitted or written.

    Per pose: how far the predicted total CoM is from the measured line of gravity, in mm, and what
    force and moment are left. Use poses that the model was not fitted to: those show what it is
    worth. Exit code 0: passed, or no limits are set; 5: a limit of robot.yaml is not met.

    \b
    Example:
      comcal verify tuesday --urdf calibrated.urdf
    """
    from comcal.identify.calibration import Verdict
    from comcal.workflow.known_model import read_model
    from comcal.workflow.verify import verify_model

    known = None if model is None else read_model(model)
    verification = verify_model(session, urdf, known)
    if as_json:
        from comcal.report.verify import verification_json

        click.echo(json.dumps(verification_json(verification), indent=1, allow_nan=False))
    else:
        from comcal.report.console import make_console
        from comcal.report.verify import print_verification

        print_verification(make_console(), verification)
    return EXIT_LIMIT if verification.verdict is Verdict.FAILED else 0
