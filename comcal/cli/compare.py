# SPDX-License-Identifier: Apache-2.0
"""``comcal compare``."""

from __future__ import annotations

import json
from pathlib import Path

import click

EXIT_CHANGED = 5


@click.command("compare")
@click.argument("a", metavar="A", type=click.Path(path_type=Path, exists=True))
@click.argument("b", metavar="B", type=click.Path(path_type=Path, exists=True))
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, nothing else.")
def compare_command(a: Path, b: Path, as_json: bool) -> int:
    """Say what changed from A to B: mass, total CoM, CoM of each link, sums of links.

    A and B are solved sessions of one robot, or their result.json. Numbers beyond 2 sigma are
    shown; of many numbers some always are, so one counts as changed beyond the limit that all of
    them together pass as rarely as one alone passes 2 sigma. Exit code 0: nothing changed; 5:
    something did.

    \b
    Example:
      comcal compare monday friday
    """
    from comcal.workflow.compare import compare_results

    comparison = compare_results(a, b)
    if as_json:
        from comcal.report.compare import comparison_json

        click.echo(json.dumps(comparison_json(comparison), indent=1, allow_nan=False))
    else:
        from comcal.report.compare import print_comparison
        from comcal.report.console import make_console

        print_comparison(make_console(), comparison)
    return EXIT_CHANGED if comparison.changed else 0
