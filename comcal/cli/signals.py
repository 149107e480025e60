# SPDX-License-Identifier: Apache-2.0
"""A terminal that hangs up and a polite kill save like Ctrl-C."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def signals_as_interrupt() -> Generator[list[int], None, None]:
    """Turn SIGTERM and SIGHUP into KeyboardInterrupt while the context lasts.

    Yields
    ------
    list of int
        The signals caught so far. A program whose terminal is gone may fail in many ways after
        the interrupt; the list tells that they all have one cause.

    Notes
    -----
    A signal that the parent ignores stays ignored: ``nohup comcal record ...`` survives its
    terminal. Outside the main thread nothing is changed, since Python allows no handler there.
    """
    caught: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        caught.append(number)
        if len(caught) == 1:  # a second one must not disturb the saving that the first began
            raise KeyboardInterrupt

    before: dict[int, object] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGTERM, signal.SIGHUP):
            handler = signal.getsignal(number)
            if handler is not signal.SIG_IGN:
                before[number] = signal.signal(number, interrupt)
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)  # pyright: ignore[reportArgumentType]
