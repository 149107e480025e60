# SPDX-License-Identifier: Apache-2.0
"""Showing a recording on a terminal; nothing where there is none."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from comcal.measure.progress import (
    Event,
    OnEvent,
    PlanChanged,
    PoseFinished,
    PoseRetried,
    PoseSkipped,
    PoseStarted,
    RecordingStarted,
    SourceOpened,
    ignore,
)


@contextmanager
def shown_progress(stream: TextIO) -> Generator[OnEvent, None, None]:
    """Yield a function that shows events: a bar and one line per pose, only on a terminal.

    Parameters
    ----------
    stream : text stream
        Usually standard error: standard output is for results.
    """
    console = Console(file=stream, highlight=False)
    if not console.is_terminal:
        yield ignore
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("recording", total=None)

        def show(event: Event) -> None:
            if isinstance(event, RecordingStarted):
                progress.update(bar, total=event.total, completed=event.finished)
            elif isinstance(event, PoseStarted):
                progress.update(bar, description=f"pose {event.pose}")
            elif isinstance(event, PoseFinished | PoseSkipped):
                progress.advance(bar)
            line = describe(event)
            if line:
                progress.console.print(line, markup=False)

        yield show


def describe(event: Event) -> str:
    """Return the line about an event; empty for those that only move the bar."""
    if isinstance(event, SourceOpened):
        verb = "going on with" if event.is_resumed else "recording from"
        return f"{verb} {event.source} ({event.engine}), seed {event.seed}"
    if isinstance(event, PoseFinished):
        return f"pose {event.pose}: still after {event.waited:.1f} s, {event.samples} samples"
    if isinstance(event, PoseRetried):
        return f"pose {event.pose}: {event.reason}; moving there once more"
    if isinstance(event, PoseSkipped):
        return f"pose {event.pose}: {event.reason}; left out"
    if isinstance(event, PlanChanged):
        return f"{event.plan} has changed since the session was begun; comparing finished poses"
    return ""
