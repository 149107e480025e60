# SPDX-License-Identifier: Apache-2.0
"""Samples of all devices on the samples of one of them: the rows of a :class:`Block`.

Of every other device a row takes the newest sample that was known when the row's own sample was.
That order is that of the frames, so it is the same live and from a log. A row of which any device
owes its part (silent for too long, saturated, status bit set, never heard) carries no wrenches:
NaN spoils every still window that it falls into.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from comcal.measure.source import Block
from comcal_drivers.source.clock import SampleClock
from comcal_drivers.source.series import Array, Series, chained, no_series

POSITION, CURRENT, TORQUE = range(3)
"""Columns of the values of a drive."""


@dataclass(frozen=True)
class Slot:
    """Where the values of one device go.

    Parameters
    ----------
    name : str
        Of the device: sensor, plate, joint or ``imu``.
    width : int
        Number of values: 6, 3 of a drive (position, current, torque), 3 of an IMU.
    timeout : float
        Age at which a value is too old [s].
    joint : int
        Index of the joint; -1: it is none.
    measures : tuple of int
        Columns that a usable sample has; the others are never there.
    """

    name: str
    width: int
    timeout: float
    joint: int = -1
    measures: tuple[int, ...] = ()

    def usable(self, values: Array) -> npt.NDArray[np.bool_]:
        """Return which samples have all that the device measures, shape (n,) of bool."""
        columns = list(self.measures) or slice(None)
        return np.asarray(np.isfinite(values[:, columns]).all(axis=1), np.bool_)


@dataclass(frozen=True)
class Pending:
    """The oldest frame that a device holds back: its place among all frames, and its stamp [s]."""

    row: int
    t: float


@dataclass
class Assembler:
    """Puts samples together as they come, however the stream is cut.

    Parameters
    ----------
    slots : sequence of Slot
    clock : str
        Name of the slot whose samples make the rows.
    time : SampleClock
        Of that device.
    joints : int
        Number of joints of the robot; NaN where none of the devices speaks for one.
    gaps : mapping from device to int
        Rows in which it owed its part, so far.
    """

    slots: Sequence[Slot]
    clock: str
    time: SampleClock
    joints: int
    gaps: dict[str, int] = field(default_factory=dict[str, int])
    _after: int = -1
    _is_whole: bool = True
    _since: float = np.inf
    """Stamp of the first tick since then [s]; infinite before there is one."""
    _held: dict[str, Series] = field(default_factory=dict[str, Series])
    """Ticks that are not settled; of other devices the last sample that was used, and all since."""

    def begin_after(self, row: int) -> None:
        """Forget what was known up to frame *row*, and begin with the first row without a gap."""
        self._after, self._is_whole, self._since = row, False, np.inf
        self._held.clear()

    def feed(self, series: Mapping[str, Series], pending: Mapping[str, Pending]) -> Block:
        """Return the rows that are settled by the newest samples, perhaps none.

        Parameters
        ----------
        series : mapping from device name to Series
            What is known since the last time; devices without news may be missing.
        pending : mapping from device name to Pending
            Of devices that hold frames back until more have come.
        """
        for slot in self.slots:
            if slot.name in series:
                held = self._held.get(slot.name)
                new = series[slot.name]
                new = new[int(np.searchsorted(new.row, self._after, side="right")) :]
                self._held[slot.name] = new if held is None else chained((held, new), slot.width)
        ticks = self._settled(pending)
        if not len(ticks):
            return self._block(np.empty(0), {s.name: no_series(s.width).values for s in self.slots})
        t = self.time.times(ticks)
        taken = {slot.name: self._taken(slot, ticks) for slot in self.slots}
        if not self._is_whole:
            whole = np.all([slot.usable(taken[slot.name]) for slot in self.slots], axis=0)
            first = int(np.argmax(whole)) if whole.any() else len(t)
            self._is_whole = bool(whole.any())
            self._count_silent(ticks[:first], taken)
            t, taken = t[first:], {name: values[first:] for name, values in taken.items()}
        for slot in self.slots:
            gaps = int(np.count_nonzero(~slot.usable(taken[slot.name])))
            self.gaps[slot.name] = self.gaps.get(slot.name, 0) + gaps
        return self._block(t, taken)

    def _count_silent(self, ticks: Series, taken: Mapping[str, Array]) -> None:
        """Count the ticks before the first whole row in which a device should long have spoken."""
        self._since = min(self._since, float(ticks.t[0])) if len(ticks) else self._since
        for slot in self.slots:
            owed = ~slot.usable(taken[slot.name][: len(ticks)])
            silent = int(np.count_nonzero(owed & (ticks.t - self._since > slot.timeout)))
            self.gaps[slot.name] = self.gaps.get(slot.name, 0) + silent

    def _settled(self, pending: Mapping[str, Pending]) -> Series:
        """Return the ticks to which nothing that is still to come can add anything.

        What a device holds back would be too old for a tick that is later by more than its
        time-out: such a tick does not wait.
        """
        clock = next(slot for slot in self.slots if slot.name == self.clock)
        ticks = self._held.get(self.clock, no_series(clock.width))
        settled = len(ticks)
        for slot in self.slots:
            if slot.name == self.clock or slot.name not in pending:
                continue
            held = pending[slot.name]
            waits = (ticks.row >= held.row) & ~(ticks.t > held.t + slot.timeout)
            settled = min(settled, int(np.argmax(waits)) if waits.any() else settled)
        return ticks[:settled]

    def _taken(self, slot: Slot, ticks: Series) -> Array:
        """Return what one device adds to every row, (n, width); NaN: too old, or not usable."""
        known = self._held.get(slot.name, no_series(slot.width))
        if slot.name == self.clock:
            at = np.arange(len(ticks))
            self._held[slot.name] = known[int(at[-1]) + 1 :]
        else:
            at = np.searchsorted(known.row, ticks.row, side="right") - 1
            self._held[slot.name] = known[max(int(at[-1]), 0) :]
        values = np.full((len(ticks), slot.width), np.nan)
        if len(known):
            place = np.maximum(at, 0)
            young = (at >= 0) & ~(ticks.t - known.t[place] > slot.timeout)
            values[young] = known.values[place[young]]
        return values

    def _block(self, t: Array, taken: Mapping[str, Array]) -> Block:
        n = len(t)
        nan = np.full((n, self.joints), np.nan)
        q, currents, torques = nan.copy(), nan.copy(), nan.copy()
        wrenches: dict[str, Array] = {}
        imu: Array | None = None
        whole: npt.NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        for slot in self.slots:
            values = taken[slot.name]
            whole = whole & slot.usable(values)
            if slot.joint >= 0:
                q[:, slot.joint] = values[:, POSITION]
                currents[:, slot.joint] = values[:, CURRENT]
                torques[:, slot.joint] = values[:, TORQUE]
            elif slot.width == 6:
                wrenches[slot.name] = values
            else:
                imu = values
        wrenches = {name: np.where(whole[:, None], w, np.nan) for name, w in wrenches.items()}
        drives = [slot for slot in self.slots if slot.joint >= 0]
        return Block(
            t=t,
            q=q,
            wrenches=wrenches,
            torques=torques if any(TORQUE in slot.measures for slot in drives) else None,
            currents=currents if any(CURRENT in slot.measures for slot in drives) else None,
            imu=imu,
        )
