# SPDX-License-Identifier: Apache-2.0
"""When a process that serves another one has to end."""

from __future__ import annotations

import os
import signal
from types import FrameType


class Leash:
    """Asked in every round of the server's loop whether to go on.

    The process ends on SIGTERM, SIGINT and SIGHUP, and when the one that started it is gone: a
    process whose parent dies gets another one. Make the leash first of all, before anything slow.
    """

    def __init__(self) -> None:
        self._parent = os.getppid()
        self._is_called = False

    def hold(self) -> None:
        """Listen to signals from now on."""
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._call)

    @property
    def is_called(self) -> bool:
        """Whether to end."""
        return self._is_called or os.getppid() != self._parent

    def _call(self, _number: int, _frame: FrameType | None) -> None:
        self._is_called = True
