# SPDX-License-Identifier: Apache-2.0
"""Single keys of a terminal as wishes of the operator, without waiting for Enter."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TextIO

from comcal.measure.operator import Nobody, Operator, Wish

WISHES = {"s": Wish.SKIP, "r": Wish.REDO, "q": Wish.QUIT}
STOP = " "
"""Stops a commanded robot, like ``q``; for a person it means nothing."""

POLL = 0.1
"""Seconds after which a reader that sees no key has to return."""

SEQUENCE = re.compile(r"\x1b(?:\[[0-9;]*[ -/]*[@-~]?|O.?|.)?", re.DOTALL)
"""What an arrow or function key sends, or Alt with a letter: several characters, no wish."""

HELP = "s skip · r redo the last pose · q save and quit"
HELP_COMMANDED = "space stop and quit · s skip · r redo the last pose"

Read = Callable[[float], "str | None"]
"""Returns what was typed within some seconds, perhaps nothing; None when no more can come."""


class Keyboard:
    """An operator at a keyboard.

    Parameters
    ----------
    read : callable
        See :data:`Read`; called from a thread of its own, so that a robot is stopped at once
        whatever the recording waits for.
    """

    def __init__(self, read: Read) -> None:
        self._read = read
        self._wishes: SimpleQueue[Wish] = SimpleQueue()
        self._is_over = threading.Event()

    def wish(self) -> Wish | None:
        """Return the oldest wish that was not returned yet."""
        try:
            return self._wishes.get_nowait()
        except Empty:
            return None

    @contextmanager
    def attend(self, stop: Callable[[], None] | None) -> Generator[None, None, None]:
        """Listen to the keys while the context lasts.

        Parameters
        ----------
        stop : callable or None
            Called at once when the robot is to stop.
        """
        self._is_over.clear()
        thread = threading.Thread(target=self._listen, args=(stop,), name="keys", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._is_over.set()
            thread.join(timeout=1.0)

    def _listen(self, stop: Callable[[], None] | None) -> None:
        while not self._is_over.is_set():
            text = self._read(POLL)
            if text is None:
                return
            for key in SEQUENCE.sub("", text).lower():
                wish = Wish.QUIT if key == STOP and stop is not None else WISHES.get(key)
                if wish is not None:
                    # The wish first: whatever stopping may raise, the recording ends.
                    self._wishes.put(wish)
                    if wish is Wish.QUIT and stop is not None:
                        # The recording stops the robot once more, and says what is wrong.
                        with suppress(Exception):
                            stop()


class TerminalKeyboard(Keyboard):
    """The keyboard of a terminal, which gives single keys without echo while it is attended.

    Parameters
    ----------
    descriptor : int
        Of the terminal. Ctrl-C and Ctrl-Z keep their meanings.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(lambda seconds: _typed(descriptor, seconds))
        self._descriptor = descriptor

    @contextmanager
    def attend(self, stop: Callable[[], None] | None) -> Generator[None, None, None]:
        """Listen to the keys; the terminal is as it was afterwards."""
        before = termios.tcgetattr(self._descriptor)
        try:
            tty.setcbreak(self._descriptor, termios.TCSANOW)
            with super().attend(stop):
                yield
        finally:
            termios.tcsetattr(self._descriptor, termios.TCSANOW, before)


def terminal_operator(stream: TextIO | None = None) -> Operator:
    """Return the operator at a terminal; nobody where there is none, or in the background.

    Parameters
    ----------
    stream : text stream or None
        None: standard input.
    """
    stream = stream or sys.stdin
    if stream is None:  # pyright: ignore[reportUnnecessaryComparison] - a detached process
        return Nobody()
    try:
        descriptor = stream.fileno()
        if not os.isatty(descriptor) or os.tcgetpgrp(descriptor) != os.getpgrp():
            return Nobody()
    except (OSError, ValueError):  # no descriptor, or no terminal that controls us
        return Nobody()
    return TerminalKeyboard(descriptor)


def _typed(descriptor: int, seconds: float) -> str | None:
    try:
        ready, _, _ = select.select([descriptor], [], [], seconds)
        if not ready:
            return ""
        typed = os.read(descriptor, 64)
    except (OSError, ValueError):  # the terminal is gone
        return None
    return typed.decode("utf-8", "replace") if typed else None
