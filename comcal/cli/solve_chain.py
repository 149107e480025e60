# SPDX-License-Identifier: Apache-2.0
"""``comcal solve`` for a chain without URDF: SESC from CoM components known by other means."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from comcal.cli.pose_list import pose_numbers

EXIT_UNUSABLE = 3


def solve_chain(session: Path, drop: Sequence[int], held_out: str, as_json: bool) -> int:
    """Fit, predict the held-out poses, write result.json, print; return the exit code.

    Raises
    ------
    click.UsageError
        If *held_out* is not a list of pose numbers.
    """
    from comcal.identify.postures import Usability
    from comcal.report.console import make_console, print_lines
    from comcal.report.postures import postures_lines
    from comcal.report.postures_json import postures_json
    from comcal.workflow.calibrate import input_hashes, load_session, write_result
    from comcal.workflow.human_postures import solve_postures

    poses = pose_numbers(held_out, "--held-out")
    opened, robot, table = load_session(session, drop)
    result = solve_postures(robot, table, held_out=poses)
    data = {**postures_json(result), "sha256": input_hashes(opened, robot)}
    files = write_result(opened, data)
    if as_json:
        click.echo(json.dumps(data, indent=1))
    else:
        print_lines(make_console(), [f"note: {note}" for note in table.notes])
        print_lines(make_console(), postures_lines(result))
        for path in files:
            click.echo(f"wrote {path}")
    return 0 if result.usability is Usability.USABLE else EXIT_UNUSABLE
