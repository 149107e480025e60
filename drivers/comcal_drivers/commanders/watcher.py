# SPDX-License-Identifier: Apache-2.0
"""Look after moving joints: a drive that fails must not leave the others running."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from comcal.errors import ComcalError, HardwareError
from comcal_drivers.canopen_setup import objects
from comcal_drivers.commanders.axis import Axis
from comcal_drivers.commanders.state_machine import TARGET_REACHED

MOVING, STANDING = 0.02, 0.25
"""Between two rounds over all drives [s]; standing drives are asked rarely, the bus is shared."""

SPEED_SPAN = 0.05
"""Speeds are measured over no less than this [s]."""
SPEED_FACTOR = 1.5
"""A joint that is faster than this times what it was told has wrong units or runs away."""
LIMIT_SLACK = 0.02
"""Overshoot beyond the limits of the URDF that is not worth a stop [rad]."""


@dataclass(frozen=True)
class Motion:
    """What is being carried out.

    Parameters
    ----------
    speeds : mapping from joint to float
        What each joint was told [rad/s].
    deadline : float
        When all must have arrived, on the monotonic clock [s].
    """

    speeds: Mapping[str, float]
    deadline: float


@dataclass(frozen=True)
class _Seen:
    position: float
    earliest: float
    """No later than when the drive took it [s]."""


class Watcher:
    """A thread that asks all drives in turn, and gives the alarm at the first that fails.

    Parameters
    ----------
    axes : sequence of Axis
    alarm : callable
        Gets the error, in the watcher's thread, once for every motion that fails.
    """

    def __init__(self, axes: Sequence[Axis], alarm: Callable[[HardwareError], None]) -> None:
        self._axes = tuple(axes)
        self._alarm = alarm
        self._lock = threading.Lock()
        self._motion: Motion | None = None
        self._is_on = False
        self._wake = threading.Event()
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def is_moving(self) -> bool:
        """Whether a motion has neither ended nor failed."""
        return self._motion is not None

    def begin(self, motion: Motion) -> None:
        """Watch a motion, and the drives that hold afterwards."""
        with self._lock:
            self._motion, self._is_on = motion, True
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="cia402 watcher", daemon=True)
            self._thread.start()
        self._wake.set()

    def pause(self) -> None:
        """Do not give the alarm any more, until the next motion begins."""
        with self._lock:
            self._motion, self._is_on = None, False

    def close(self, timeout: float = 5.0) -> None:
        """End the thread."""
        self.pause()
        self._end.set()
        self._wake.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout)

    def _run(self) -> None:
        seen: dict[str, _Seen] = {}
        while not self._end.is_set():
            self._wake.clear()
            motion = self._motion
            if self._is_on:
                try:
                    arrived = [self._look(axis, motion, seen) for axis in self._axes]
                    self._judge(motion, arrived)
                except ComcalError as error:
                    self._give_alarm(motion, error)
                    seen.clear()
            self._wake.wait(MOVING if self._motion is not None else STANDING)

    def _look(self, axis: Axis, motion: Motion | None, seen: dict[str, _Seen]) -> bool:
        """Ask one drive; return whether it has arrived."""
        name = axis.units.joint
        if self._end.is_set() or not self._is_on:
            return False
        word = axis.statusword()
        axis.check(word)
        if axis.drive.remote.emcy.active:
            raise axis.drive.failure(
                f"sent an emergency message: {axis.drive.remote.emcy.active[-1]}",
                next_step="look the code up in the manual of the drive",
            )
        if motion is None:
            seen.pop(name, None)
            return True
        before = time.monotonic()
        position = axis.units.position(axis.drive.read(objects.POSITION, signed=True))
        after = time.monotonic()
        if not axis.lower - LIMIT_SLACK <= position <= axis.upper + LIMIT_SLACK:
            raise axis.drive.failure(
                "has left the limits of its joint",
                measured=f"{position:.4f} rad",
                limit=f"{axis.lower:.4f} to {axis.upper:.4f} rad",
                next_step="check zero, gear and sign in robot.yaml before it moves again",
            )
        last = seen.get(name)
        # The longest time that may lie between the two positions: no false alarm by a slow bus.
        if last is None:
            seen[name] = _Seen(position, before)
        elif after - last.earliest >= SPEED_SPAN:
            self._check_speed(axis, motion, abs(position - last.position), after - last.earliest)
            seen[name] = _Seen(position, before)
        return bool(word & TARGET_REACHED)

    def _check_speed(self, axis: Axis, motion: Motion, way: float, span: float) -> None:
        told = motion.speeds.get(axis.units.joint, 0.0)
        ticks = 2.0 / abs(axis.units.counts_per_radian)
        limit = SPEED_FACTOR * told + ticks / span + axis.units.speed_unit
        if way / span > limit:
            raise axis.drive.failure(
                "is faster than it was told",
                measured=f"{way / span:.3g} rad/s",
                limit=f"{limit:.3g} rad/s",
                next_step="check velocity_unit, counts_per_turn and gear in robot.yaml",
            )

    def _judge(self, motion: Motion | None, arrived: Sequence[bool]) -> None:
        if motion is None:
            return
        if all(arrived):
            with self._lock:
                if self._motion is motion:
                    self._motion = None
        elif time.monotonic() > motion.deadline:
            late = [a.units.joint for a, ok in zip(self._axes, arrived, strict=True) if not ok]
            raise HardwareError(
                "has not arrived in time",
                where=f"joint {', '.join(late)}",
                next_step="see what holds it; check the position window (0x6067) of its drive",
            )

    def _give_alarm(self, motion: Motion | None, error: ComcalError) -> None:
        with self._lock:
            if not self._is_on or self._motion is not motion:
                return
            self._motion, self._is_on = None, False
        kind = error if isinstance(error, HardwareError) else HardwareError(str(error))
        self._alarm(kind)
