# SPDX-License-Identifier: Apache-2.0
"""The channels of a pose table one by one, and how one is taken out of it or made less certain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from comcal.measure.table import PoseTable
from comcal.robot.changes import IMU
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS
from comcal.robot.model import Robot
from comcal.robot.tree import Array

Mask = npt.NDArray[np.bool_]
ROUNDING = 1e-9
"""Numbers this close, as a part of the largest one of a channel, are the same: averaging rounds."""
SCATTER = 0.03
"""Samples that differ by less than this part of the error of their mean are those of an engine
without noise, which still moves a little."""


@dataclass(frozen=True)
class Channel:
    """One number per pose.

    Parameters
    ----------
    target : str
        Sensor, plate, joint or ``imu``.
    name : str
        As the effects name it: ``fx`` .. ``tz``, ``q``, ``i``, ``tau``, ``ax`` ..
    unit : str
    values, variance : array, shape (N,)
        NaN where absent.
    sd : array, shape (N,)
        Of the single samples of a window; NaN where not given.
    field : tuple of str
        Fields of the table that hold values and variances: mappings by target for wrenches.
    column : int
        In those.
    """

    target: str
    name: str
    unit: str
    values: Array
    variance: Array
    sd: Array
    field: tuple[str, str]
    column: int

    @property
    def resolution(self) -> float:
        """Difference below which two readings are one and the same number."""
        return ROUNDING * float(np.nanmax(np.abs(self.values), initial=1e-300))

    @property
    def has_sd(self) -> bool:
        """Whether the windows tell their standard deviation."""
        return bool(np.isfinite(self.sd).any())

    @property
    def stands_still(self) -> Mask:
        """In which poses all samples were one and the same number, shape (N,)."""
        return np.asarray(np.isfinite(self.values) & (self.sd <= self.resolution), np.bool_)

    @property
    def scatters(self) -> Mask:
        """In which poses samples differ by what could be noise, shape (N,)."""
        least = SCATTER * np.sqrt(np.nan_to_num(self.variance))
        return np.asarray(
            np.isfinite(self.values) & (self.sd > np.maximum(least, self.resolution)), np.bool_
        )

    @property
    def is_constant(self) -> bool:
        """Whether all poses have the same reading."""
        return bool(np.nanmax(self.values) - np.nanmin(self.values) <= self.resolution)


_WRENCH = ("wrench", "wrench_cov")
_JOINT_FIELDS = {
    "q": (("q", "q_cov"), "rad"),
    "i": (("current", "current_var"), "A"),
    "tau": (("torque", "torque_var"), "N m"),
}


def channels(robot: Robot, table: PoseTable) -> tuple[Channel, ...]:
    """Return every channel that has a reading in *table*."""
    nothing = np.full(len(table), np.nan)

    def sd(column: str) -> Array:
        return table.motion.get(f"sd.{column}", nothing)

    found: list[Channel] = []
    for s, w in table.wrench.items():
        for k, c in enumerate(CHANNELS):
            variance, unit = table.wrench_cov[s][:, k, k], "N" if c[0] == "f" else "N m"
            found.append(Channel(s, c, unit, w[:, k], variance, sd(f"ft.{s}.{c}"), _WRENCH, k))
    for k, joint in enumerate(robot.tree.joint_names):
        for c, (field, unit) in _JOINT_FIELDS.items():
            values, variance = (getattr(table, name)[:, k] for name in field)
            found.append(Channel(joint, c, unit, values, variance, sd(f"{c}.{joint}"), field, k))
    for k, c in enumerate(IMU_CHANNELS):
        values, variance, field = table.imu[:, k], table.imu_var[:, k], ("imu", "imu_var")
        found.append(Channel(IMU, c, "m/s^2", values, variance, sd(f"imu.{c}"), field, k))
    return tuple(c for c in found if np.isfinite(c.values).any())


def instruments(found: Sequence[Channel]) -> Iterator[tuple[Channel, ...]]:
    """Yield the channels of each force/torque sensor and of the IMU together."""
    for target in dict.fromkeys(c.target for c in found):
        of = tuple(c for c in found if c.target == target)
        if of[0].name in (*CHANNELS, *IMU_CHANNELS):
            yield of


def scatters(found: Sequence[Channel]) -> bool | None:
    """Return whether some channel mostly scatters within windows; None where no window tells."""
    known = [c for c in found if c.has_sd]
    return any(2 * c.scatters.sum() > np.isfinite(c.values).sum() for c in known) if known else None


def without(table: PoseTable, channel: Channel, rows: Mask) -> PoseTable:
    """Return *table* with NaN for the readings of a channel in some poses."""
    name, k = channel.field[0], channel.column
    held = getattr(table, name)
    values: Array = (held[channel.target] if channel.field is _WRENCH else held).copy()
    values[rows, k] = np.nan
    new = {**held, channel.target: values} if channel.field is _WRENCH else values
    return replace(table, **{name: new})


def widened(table: PoseTable, channel: Channel, more: float) -> PoseTable:
    """Return *table* with a variance of a channel that is larger by *more* in all poses."""
    name, k = channel.field[1], channel.column
    held = getattr(table, name)
    if channel.field is _WRENCH:
        cov = held[channel.target].copy()
        cov[:, k, k] += more
        return replace(table, **{name: {**held, channel.target: cov}})
    variance = held.copy()
    variance[:, k] += more
    return replace(table, **{name: variance})
