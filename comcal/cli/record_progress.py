# SPDX-License-Identifier: Apache-2.0
"""Showing a recording.

In a simulation: a bar and a line per pose on a terminal, nothing elsewhere. At a real robot: the
live table on a terminal, with a beep for every finished pose; elsewhere a line every few seconds,
because somebody waits for it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from comcal.cli.live_table import Screen, live_table, status_line
from comcal.measure.progress import (
    Event,
    OnEvent,
    PlanChanged,
    PoseFinished,
    PoseObserved,
    PoseRepeated,
    PoseRetried,
    PoseSkipped,
    PoseStarted,
    RecordingStarted,
    SidesMissing,
    SourceOpened,
)

LINE_EVERY = 5.0
"""Seconds between two status lines where there is no terminal."""

REFRESH = 4.0
"""Pictures per second, so that the age of the readings grows while none come."""


@contextmanager
def shown_progress(
    stream: TextIO, keys: str = "", clock: Callable[[], float] = time.monotonic
) -> Generator[OnEvent, None, None]:
    """Yield a function that shows events.

    Parameters
    ----------
    stream : text stream
        Usually standard error: standard output is for results.
    keys : str
        What can be typed at a real robot.
    clock : callable
        Returns seconds.
    """
    console = Console(file=stream, highlight=False)
    if not console.is_terminal:
        yield _Lines(stream, clock).show
        return
    display = _Display(console, keys, clock)
    try:
        yield display.show
    finally:
        display.close()


class _Tally:
    """Counts the poses that are done, and keeps the newest observation."""

    def __init__(self, clock: Callable[[], float], keys: str = "") -> None:
        self._clock = clock
        self._keys = keys
        self._total = self._done = 0
        self._seen: PoseObserved | None = None
        self._seen_at = 0.0

    def count(self, event: Event) -> None:
        if isinstance(event, RecordingStarted):
            self._total, self._done = event.total, event.finished
        elif isinstance(event, PoseFinished | PoseSkipped):
            self._done += 1
        elif isinstance(event, PoseRepeated):
            self._total += 1
        elif isinstance(event, PoseObserved):
            self._seen, self._seen_at = event, self._clock()

    @property
    def is_guided(self) -> bool:
        return self._seen is not None

    def screen(self) -> Screen | None:
        if self._seen is None:
            return None
        number = min(self._done + 1, self._total)
        age = self._clock() - self._seen_at
        return Screen(self._seen.observation, number, self._total, age, self._keys)


class _Lines:
    """Plain lines, once the recording turns out to be one at a real robot."""

    def __init__(self, stream: TextIO, clock: Callable[[], float]) -> None:
        self._stream = stream
        self._clock = clock
        self._tally = _Tally(clock)
        self._next = float("-inf")

    def show(self, event: Event) -> None:
        self._tally.count(event)
        if isinstance(event, PoseStarted):
            self._next = float("-inf")
        line = describe(event) if self._tally.is_guided else ""
        screen = self._tally.screen()
        if isinstance(event, PoseObserved) and screen is not None and self._clock() >= self._next:
            self._next = self._clock() + LINE_EVERY
            line = status_line(screen)
        if line:
            self._stream.write(line + "\n")
            self._stream.flush()


class _Display:
    """A terminal: a bar, replaced by the live table at the first observation."""

    def __init__(self, console: Console, keys: str, clock: Callable[[], float]) -> None:
        self._console = console
        self._tally = _Tally(clock, keys)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        self._progress = Progress(*columns, TimeRemainingColumn(), console=console, transient=True)
        self._bar = self._progress.add_task("recording", total=None)
        self._live: Live | None = None

    def show(self, event: Event) -> None:
        self._tally.count(event)
        if isinstance(event, RecordingStarted):
            self._progress.update(self._bar, total=event.total, completed=event.finished)
            self._progress.start()
        elif isinstance(event, PoseStarted):
            self._progress.update(self._bar, description=f"pose {event.pose}")
        elif isinstance(event, PoseFinished | PoseSkipped):
            self._progress.advance(self._bar)
        elif isinstance(event, PoseObserved) and self._live is None:
            self._progress.stop()
            self._live = Live(
                get_renderable=self._picture,
                console=self._console,
                refresh_per_second=REFRESH,
                transient=True,
            )
            self._live.start()
        line = describe(event)
        if line:
            self._console.print(line, markup=False)
        if isinstance(event, PoseFinished) and self._tally.is_guided:
            self._console.bell()

    def close(self) -> None:
        if self._live is not None:
            self._live.stop()
        self._progress.stop()

    def _picture(self) -> RenderableType:
        screen = self._tally.screen()
        return Text() if screen is None else live_table(screen)


def describe(event: Event) -> str:
    """Return the line about an event; empty for those that only move the bar."""
    if isinstance(event, SourceOpened):
        verb = "going on with" if event.is_resumed else "recording from"
        seed = "" if event.seed is None else f", seed {event.seed}"
        return f"{verb} {event.source} ({event.engine}){seed}"
    if isinstance(event, PoseFinished):
        return f"pose {event.pose}: still after {event.waited:.1f} s, {event.samples} samples"
    if isinstance(event, PoseRetried):
        return f"pose {event.pose}: {event.reason}; trying once more"
    if isinstance(event, PoseSkipped):
        return f"pose {event.pose}: {event.reason}" + ("" if event.by_operator else "; left out")
    if isinstance(event, PoseRepeated):
        return f"pose {event.pose} is measured again, as pose {event.as_pose}"
    if isinstance(event, PlanChanged):
        return f"{event.plan} has changed since the session was begun; comparing finished poses"
    if isinstance(event, SidesMissing):
        return _without_room(event)
    return ""


def _without_room(event: SidesMissing) -> str:
    first, joints = next(iter(event.joints.items()))
    rest = len(event.joints) - 1
    more = f", and joints of {rest} more poses" if rest > 1 else ", and of one more" if rest else ""
    return (
        f"no room to come from the side wanted (limits, floor or balance): {', '.join(joints)} in "
        f"pose {first}{more}"
    )
