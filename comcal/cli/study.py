# SPDX-License-Identifier: Apache-2.0
"""``comcal study``."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import click

EXIT_LIMIT = 5


@click.command("study")
@click.argument("study", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Folder of the results [default: `output:` of FILE, else its name, in this folder].",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes [default: `workers:` of FILE, else one per core]; results do not depend on it.",
)
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    metavar="N",
    help="Only the first N calibrations of each robot, noise and master seed.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON, nothing else.")
def study_command(
    study: Path, output: Path | None, workers: int | None, limit: int | None, as_json: bool
) -> int:
    """Calibrate simulated robots again and again and compare with what is true.

    FILE names robots, noise and seeds. Every calibration builds a robot that differs from its URDF
    as much as robot.yaml tolerates, measures it in the built-in world and solves. Printed are how
    often 95 % intervals hold the truth and how the errors compare with the Cramer-Rao bound.
    Exit code 5: a limit is not met.

    Type the same command again to go on after an interruption.

    \b
    Example:
      comcal study tests/studies/sample.yaml --workers 2
    """
    # Imported late, so that --help does not wait for the numerics.
    from comcal.measure.files import write_atomically
    from comcal.report.console import make_console, print_lines
    from comcal.report.study import study_as_json, study_lines
    from comcal.workflow.study import StudyOrder, run_study

    with _shown_progress() as show:
        outcome = run_study(StudyOrder(study, output, workers, limit), show)
    text = json.dumps(study_as_json(outcome.summary), indent=2, allow_nan=False)
    write_atomically(outcome.directory / "summary.json", f"{text}\n".encode())
    if as_json:
        click.echo(text)
    else:
        print_lines(make_console(), study_lines(outcome.summary))
        click.echo(f"wrote {outcome.directory}: results.jsonl, summary.json, study.json, robots/")
    return 0 if outcome.summary.passed else EXIT_LIMIT


@contextmanager
def _shown_progress() -> Generator[Callable[[int, int], None], None, None]:
    """Yield a function that shows how far a study is; on a terminal only."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from comcal.report.console import make_console
    from comcal.workflow.study import ignore

    console = make_console(stderr=True, file=sys.stderr)
    if not console.is_terminal:
        yield ignore
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task("calibrations", total=None)

        def show(done: int, total: int) -> None:
            progress.update(bar, completed=done, total=total)

        yield show
