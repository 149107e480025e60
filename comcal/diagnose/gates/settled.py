# SPDX-License-Identifier: Apache-2.0
r"""Readings that still move: their slopes within the windows are larger than noise makes them.

White noise gives the slope of a window of n samples over T seconds a standard deviation of
:math:`\sqrt{12/n}\,/\,T` standard deviations of a sample, the same factor for every channel. How
long the windows were, the table does not say; the quieter channels do: a robot that sways does not
move all of them. How large the largest of all slopes, and of all channels, may be is derived in
:mod:`comcal.diagnose.gates.slope_limits`. Tables that know their accelerations are left alone:
those are accounted for.

All channels that come to rest in the same time are off by the same multiple of their slopes, in
one direction of all residuals together. That direction is left open from then on: nothing else may
be found in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from comcal.diagnose.catalogue import Coordinate
from comcal.diagnose.diagnosis import Finding
from comcal.diagnose.gates.channels import Channel, Mask, channels, widened
from comcal.diagnose.gates.gated import Gated, ids, listed
from comcal.diagnose.gates.slope_limits import (
    MAD,
    largest_limit,
    mean_square_limit,
    shared_noise,
)
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import CHANNELS
from comcal.robot.tree import Array

SWAY = 0.2
"""What a slope does to a reading [s]: a robot sways at about 1 Hz, with an amplitude of its slope
over 2 pi 1 Hz."""
FEWEST = 8
"""Poses without which the noise of slopes is not known."""
GROSS = 10.0
"""Standard deviations of a slope below which no pose is refused, however unlikely they are: windows
may differ in their length, and noise need not be white."""
MATTERS = 3.0
"""Errors of a mean that the slope must make within ``SWAY``."""
WANES = 1.5
"""Time in which a sway is taken to fall to a third [s]."""
MOST_MOVING = 0.25
"""Part of the poses in which a robot may have moved, and causes are still looked for in others: it
hardly stood still in those."""
LEAVES: Mapping[Coordinate, float] = {("not_settled", "", "time"): 0.75}
"""Time over which readings may lead along their slopes to where they come to rest [s]."""


@dataclass(frozen=True)
class _Slopes:
    """Of one force/torque channel: slopes per second, and what noise makes of them, shape (N,)."""

    channel: Channel
    slope: Array
    noise: float

    @property
    def number(self) -> int:
        """Of slopes."""
        return int(np.isfinite(self.slope).sum())

    def gross(self, limit: float) -> Mask:
        """Return in which poses a slope is so many times as large as noise, and matters."""
        size, error = np.abs(self.slope), np.sqrt(self.channel.variance)
        return np.asarray((size > limit * self.noise) & (size * SWAY > MATTERS * error), np.bool_)


def settled(assumed: Assumed, so_far: Gated) -> Gated:
    """Refuse poses in which the robot plainly moved, and widen channels that are not at rest."""
    table = so_far.table
    if any(name.startswith("qdd.") for name in table.motion):
        return so_far
    found = _found(assumed, so_far)
    if not found:
        return so_far
    slopes = _with_noise(found, _typical)
    numbers = [s.number for s in slopes]
    likely = largest_limit(sum(numbers), min(numbers), len(numbers))
    limit = max(GROSS, likely)
    gross = _beyond(slopes, limit)
    if gross.any():
        # Where a robot plainly moves in some poses, more than chance is enough in others.
        gross = _beyond(slopes, likely)
        so_far = _refused(so_far, slopes, gross, likely)
    left = [(c, np.where(gross, np.nan, slope)) for c, slope in found]
    left = [(c, slope) for c, slope in left if np.isfinite(slope).sum() >= FEWEST]
    return _widened(so_far, _with_noise(left, _root_mean_square)) if left else so_far


def _beyond(slopes: list[_Slopes], limit: float) -> Mask:
    """Return in which poses any channel is beyond a limit."""
    return np.asarray(np.any([s.gross(limit) for s in slopes], axis=0), np.bool_)


def _found(assumed: Assumed, so_far: Gated) -> list[tuple[Channel, Array]]:
    """Return the force/torque channels that scatter, with their slopes."""
    found: list[tuple[Channel, Array]] = []
    for c in channels(assumed.robot, so_far.table):
        slope = so_far.table.motion.get(f"slope.ft.{c.target}.{c.name}")
        if c.name in CHANNELS and slope is not None and not so_far.is_coarse(c.target, c.name):
            rows = c.scatters & np.isfinite(slope)
            if rows.sum() >= FEWEST and slope[rows].any():
                found.append((c, np.where(rows, slope, np.nan)))
    return found


def _typical(slope: Array) -> float:
    """Return the standard deviation of slopes some of which may be gross."""
    return float(np.nanmedian(np.abs(slope))) / MAD


def _root_mean_square(slope: Array) -> float:
    return float(np.sqrt(np.nanmean(slope**2)))


def _with_noise(
    found: list[tuple[Channel, Array]], spread: Callable[[Array], float]
) -> list[_Slopes]:
    """Judge what noise makes of the slopes by the quieter quarter of the channels."""
    sd = [float(np.median(c.sd[c.scatters])) for c, _ in found]
    ratios = [spread(slope) / s for (_, slope), s in zip(found, sd, strict=True)]
    factor = shared_noise(np.array(ratios))
    return [_Slopes(c, slope, factor * s) for (c, slope), s in zip(found, sd, strict=True)]


def _refused(so_far: Gated, slopes: list[_Slopes], rows: Mask, limit: float) -> Gated:
    """Leave out all forces, torques and accelerations of poses in which the robot plainly moved."""
    table = so_far.table
    moved = rows[:, None]
    table = replace(
        table,
        wrench={sensor: np.where(moved, np.nan, w) for sensor, w in table.wrench.items()},
        current=np.where(moved, np.nan, table.current),
        torque=np.where(moved, np.nan, table.torque),
        imu=np.where(moved, np.nan, table.imu),
    )
    sizes = [float(np.nanmax(np.abs(s.slope[rows]), initial=0.0)) / s.noise for s in slopes]
    fastest, worst = slopes[int(np.argmax(sizes))].channel, max(sizes)
    poses = ids(table, rows)
    finding = Finding(
        "not_settled",
        "",
        _change(worst / limit),
        f"in {listed(poses)} the robot was still moving: {fastest.target}.{fastest.name} changes "
        f"{worst:.0f} times as fast as noise makes it (limit {limit:.3g})",
        poses,
        "all readings but angles left out",
        "wait longer before reading, or hold the robot stiffer",
    )
    found = so_far.found(table, (finding,), LEAVES)
    return replace(found, is_fit=found.is_fit and rows.mean() <= MOST_MOVING)


def _widened(so_far: Gated, slopes: list[_Slopes]) -> Gated:
    """Add what is left of the motion to the variance of the channels that show it."""
    table, names, worst = so_far.table, list[str](), 1.0
    fewest = min(s.number for s in slopes)
    for s in slopes:
        ratio = float(np.nanmean(s.slope**2)) / s.noise**2
        limit = mean_square_limit(s.number, fewest, len(slopes))
        more = (ratio - 1.0) * (s.noise * SWAY) ** 2
        if ratio > limit and more > float(np.nanmedian(s.channel.variance)):
            table = widened(table, s.channel, more)
            names.append(f"{s.channel.target}.{s.channel.name}")
            worst = max(worst, float(np.sqrt(ratio)))
    if not names:
        return so_far
    finding = Finding(
        "not_settled",
        "",
        _change(worst),
        f"slopes within the windows of {', '.join(names)} are up to {worst:.1f} times what noise "
        "makes them: the robot was not quite at rest",
        (),
        "what a sway of 1 Hz with such slopes does was added to the variance",
        "wait longer before reading, or hold the robot stiffer",
    )
    return so_far.found(table, (finding,), LEAVES)


def _change(times: float) -> Change:
    """Return how much longer to wait until slopes are *times* smaller, as a change."""
    return Change("not_settled", "", {"time": float(WANES * np.log(max(times, 1.0)))})
