# SPDX-License-Identifier: Apache-2.0
"""``comcal report``."""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command("report")
@click.argument(
    "sessions", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "-o",
    "--output",
    default="report.html",
    show_default=True,
    type=click.Path(path_type=Path),
    help="The page to write; an existing file is not overwritten.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the path as JSON, nothing else.")
def report_command(sessions: tuple[Path, ...], output: Path, as_json: bool) -> None:
    """Write one page about the newest diagnosis and calibration of the session in DIR.

    Several sessions are compared in a table, with each of them below it. The page holds its
    drawings; it needs neither scripts nor a network.

    \b
    Example:
      comcal report monday tuesday -o week.html
    """
    from comcal.workflow.report import report_sessions

    path = report_sessions(sessions, output)
    click.echo(json.dumps({"report": str(path)}) if as_json else f"wrote {path}")
