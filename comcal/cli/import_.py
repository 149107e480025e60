# SPDX-License-Identifier: Apache-2.0
"""``comcal import``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from comcal.workflow.import_ import ImportOutcome


@click.command("import")
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--map",
    "map_path",
    metavar="MAP.yaml",
    required=True,
    type=click.Path(path_type=Path),
    help="Which column is what, in which unit; the robot; still windows (format comcal-map/1).",
)
@click.option(
    "-s",
    "--session",
    "directory",
    metavar="DIR",
    required=True,
    type=click.Path(path_type=Path),
    help="Session folder to make; nothing is ever overwritten.",
)
@click.option(
    "--quasi-static",
    is_flag=True,
    help="The robot never stood still: take the slowest windows, spread over the postures, and "
    "add the error of the neglected inertia.",
)
@click.option(
    "--from", "start", type=float, metavar="T", help="Leave out what was logged before [s]."
)
@click.option(
    "--to", "end", type=float, metavar="T", help="Leave out what was logged from then on [s]."
)
@click.option("--json", "as_json", is_flag=True, help="Print the outcome as JSON, nothing else.")
def import_command(
    file: Path,
    map_path: Path,
    directory: Path,
    quasi_static: bool,
    start: float | None,
    end: float | None,
    as_json: bool,
) -> None:
    """Make a session of a logger's CSV FILE, plain or compressed by gzip.

    Each row is a pose, unless MAP.yaml declares still windows or a column of pose numbers. Numbers
    that cannot be right (units, signs, not still, gaps) are refused, and then nothing is left
    behind.

    \b
    Example:
      comcal import log.csv --map map.yaml -s monday
    """
    from comcal.workflow.import_ import import_as_json, import_log

    between = None
    if start is not None or end is not None:
        between = (-math.inf if start is None else start, math.inf if end is None else end)
    outcome = import_log(file, map_path, directory, quasi_static=quasi_static, between=between)
    if as_json:
        click.echo(json.dumps(import_as_json(outcome), indent=2))
        return
    for note in outcome.notes:
        click.echo(f"note: {note}")
    how = "slowest windows" if quasi_static else "poses"
    click.echo(f"{outcome.poses} {how} of {outcome.robot} in {outcome.poses_csv}")
    click.echo(f"joints moved by {_ranges(outcome)}")
    click.echo(f"next: comcal solve {directory}")


def _ranges(outcome: ImportOutcome) -> str:
    """Return how far each joint moved, in degrees or millimetres."""
    texts = [
        f"{name} {1e3 * span:.0f} mm"
        if name in outcome.slides
        else f"{name} {math.degrees(span):.0f} deg"
        for name, span in outcome.ranges.items()
    ]
    return ", ".join(texts) or "nothing: the robot has no joints"
