# SPDX-License-Identifier: Apache-2.0
"""``comcal solve`` for a chain without URDF: SESC from CoM components known by other means."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click


def solve_chain(session: Path, drop: Sequence[int], held_out: str, as_json: bool) -> int:
    """Fit, predict the held-out poses, print; return the exit code.

    Raises
    ------
    click.UsageError
        If *held_out* is not a list of pose numbers.
    """
    from comcal.report.postures import postures_lines
    from comcal.report.postures_json import postures_json
    from comcal.workflow.calibrate import load_session
    from comcal.workflow.human_postures import solve_postures

    try:
        poses = [int(part) for part in held_out.split(",") if part.strip()]
    except ValueError:
        raise click.UsageError(f"--held-out {held_out!r}: give pose numbers as 4,7,8") from None
    _, robot, table = load_session(session, drop)
    result = solve_postures(robot, table, held_out=poses)
    if as_json:
        click.echo(json.dumps(postures_json(result), indent=1))
    else:
        for line in postures_lines(result):
            click.echo(line)
    return 0
