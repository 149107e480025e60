# SPDX-License-Identifier: Apache-2.0
"""The person beside the robot: what is wished for while a pose is waited for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from enum import Enum
from typing import Protocol


class Wish(Enum):
    """What the person wants now."""

    SKIP = "skip"
    """Leave this pose out and go on with the next one."""
    REDO = "redo"
    """Measure the last finished pose again, then go on with this one."""
    QUIT = "quit"
    """End the recording; everything finished is saved. A robot that moves has been stopped."""


class Operator(Protocol):
    """Somebody who attends the recording."""

    def attend(self, stop: Callable[[], None] | None) -> AbstractContextManager[object]:
        """Attend while the context lasts.

        Parameters
        ----------
        stop : callable or None
            Stops a commanded robot; called from any thread, at once when that is wished. None: a
            person moves the robot.
        """
        ...

    def wish(self) -> Wish | None:
        """Return the oldest wish that was not returned yet, without waiting for one."""
        ...


class Nobody:
    """An operator without a keyboard: never wishes anything."""

    def attend(self, stop: Callable[[], None] | None) -> AbstractContextManager[object]:
        """Do nothing."""
        return nullcontext()

    def wish(self) -> Wish | None:
        """Return None."""
        return None


class Person:
    """The commander of a robot that a person moves: looks on."""

    def move_to(self, pose: object) -> None:
        """Leave it to the person, to whom the wanted pose is shown."""
