# SPDX-License-Identifier: Apache-2.0
"""Readings that lie on a grid which is coarse against what is stated of their error.

Averages of windows betray a grid as long as most windows see one step only, which is when its
error matters: noise of a third of a step makes averages as fine as if there were no grid. Where
windows tell how far their samples scatter, two steps betray themselves by that as well.

What a grid does to a reading that hardly changes is the same in all poses: an offset of the
channel, which no fault has to explain.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from comcal.diagnose.catalogue import Coordinate
from comcal.diagnose.diagnosis import Finding
from comcal.diagnose.gates.channels import Channel, channels, widened
from comcal.diagnose.gates.gated import Gated
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import CHANNELS
from comcal.robot.tree import Array

FEWEST = 5
"""Different numbers that must share a grid; of windows that stood still, and so lie on the grid of
the samples, fewer are enough."""
FEWEST_STILL = 4
MATTERS = 0.1
"""Of the stated variance: a grid whose step^2 / 12 is smaller changes nothing."""
LARGEST_SHARE = 400
"""Averages of so many samples are searched for the grid of the samples."""
MOST = 0.5
"""Part of the windows that must lie on the grid of the samples ..."""
EXCESS = 5.0
"""... by how many standard deviations more than by chance ..."""
AS_EXPECTED = 0.01
"""Difference of a deviation from what two steps make of it, in steps."""
KEEPS = 0.9
"""... and which part of those on a grid must also lie on a multiple of it: half do by chance."""
LARGEST_ANGLE_STEP = 0.01
"""Of an encoder [rad] or [m]: angles on a coarser grid are those of a plan, not of an encoder."""
OFFSETS = {"q": "joint_offset", "i": "current_offset"}
"""By channel of a joint."""
ROUNDS = 40
ALIKE = 1e-6
"""Relative difference of steps that are the same."""


def quantised(assumed: Assumed, so_far: Gated) -> Gated:
    """Add step^2 / 12 to the variance of channels that lie on a grid."""
    table = so_far.table
    found = [(c, step) for c in channels(assumed.robot, table) if (step := grid_step(c))]
    together: dict[tuple[str, str], list[tuple[Channel, float]]] = {}
    for channel, step in found:
        together.setdefault((channel.target, channel.unit), []).append((channel, step))
    by_step: dict[tuple[str, str, str], list[Channel]] = {}
    leaves: dict[Coordinate, float] = {}
    for channel, own in (*found, *_also_on_a_grid(channels(assumed.robot, table), together)):
        step = _shared_step(own, [s for _, s in together[channel.target, channel.unit]])
        error = step / np.sqrt(12.0)
        table = widened(table, channel, error**2)
        offset = _offset_of(channel)
        if offset is not None:
            leaves[offset] = error
        by_step.setdefault((channel.target, channel.unit, f"{step:.6g}"), []).append(channel)
    named = tuple(_finding(t, float(step), of) for (t, _, step), of in by_step.items())
    return so_far.found(table, named, leaves)


def _offset_of(channel: Channel) -> Coordinate | None:
    """Return the coordinate that is the offset of a channel, if there is one."""
    if channel.name in CHANNELS:
        return "ft_bias", channel.target, channel.name
    effect = OFFSETS.get(channel.name)
    return None if effect is None else (effect, channel.target, "offset")


def _also_on_a_grid(
    every: Iterable[Channel], together: Mapping[tuple[str, str], Sequence[tuple[Channel, float]]]
) -> Iterator[tuple[Channel, float]]:
    """Yield channels that show too few numbers for a grid of their own, but fit that of the others.

    A force that hardly changes may be the same multiple of the step in all poses.
    """
    for channel in every:
        others = together.get((channel.target, channel.unit), ())
        if not others or any(channel.name == other.name for other, _ in others):
            continue
        step = max(step for _, step in others)
        values = np.unique(channel.values[channel.stands_still])
        on = np.diff(values) / step
        if values.size and np.all(np.abs(on - np.round(on)) * step <= 10.0 * channel.resolution):
            yield channel, step


def _shared_step(own: float, others: Iterable[float]) -> float:
    """Return the step of a like channel of the same converter, of which one's own is a part."""
    return max(s for s in others if abs(s / own - round(s / own)) < ALIKE * s / own)


def grid_step(channel: Channel) -> float | None:
    """Return the step of the grid on which the readings of a channel lie, if it matters."""
    values = np.unique(channel.values[np.isfinite(channel.values)])
    variance = channel.variance[np.isfinite(channel.variance)]
    if not variance.size or not np.median(variance) > 0.0:
        return None
    least = float(np.sqrt(12.0 * MATTERS * np.median(variance)))
    step = _of_samples(channel, least) or _of_averages(channel, values, least)
    if step is None or step < least or (channel.name == "q" and step > LARGEST_ANGLE_STEP):
        return None
    return step


def _of_samples(channel: Channel, least: float) -> float | None:
    """Return the grid of windows that stood still."""
    still = channel.stands_still
    if not channel.scatters.any() and still.sum() < np.isfinite(channel.values).sum():
        return None
    values = np.unique(channel.values[still])
    return _common_step(values, channel.resolution, least, FEWEST_STILL)


def _of_averages(channel: Channel, values: Array, least: float) -> float | None:
    """Return the grid of samples whose averages are given."""
    fine = _common_step(values, channel.resolution, least / LARGEST_SHARE, FEWEST)
    if fine is None:
        return None
    known = np.isfinite(channel.values)
    numbers = np.round((channel.values[known] - values[0]) / fine).astype(np.int64)
    return fine * (_share_by_scatter(numbers, channel.sd[known] / fine) or _share(numbers))


def _common_step(values: Array, resolution: float, least: float, fewest: int) -> float | None:
    """Return the largest step of which all differences are multiples, None below *least*."""
    gaps = np.diff(values)
    gaps = gaps[gaps > 10.0 * resolution]
    if gaps.size + 1 < fewest:
        return None
    step = float(gaps.min())
    for _ in range(ROUNDS):
        whole = np.round(gaps / step)
        left = np.abs(gaps - whole * step)
        if left.max() <= 10.0 * resolution:
            return float(whole @ gaps / (whole @ whole))
        step = float(left[left > 10.0 * resolution].min())
        if step < max(least, 100.0 * resolution):
            return None
    return None


def _share_by_scatter(numbers: npt.NDArray[np.int64], sd: Array) -> int | None:
    """Return how many times coarser the grid of the samples is, by how far they scatter.

    Of n samples on two neighbouring steps, a part f on the upper one, the average lies f of a step
    above the lower one, and the deviation is sqrt(n / (n - 1) f (1 - f)) steps.

    Parameters
    ----------
    numbers : array of int, shape (N,)
        Averages on their own grid, which is n times finer.
    sd : array, shape (N,)
        Of the samples of each window, in the same unit; NaN where not given.
    """
    best, share = max(FEWEST_STILL - 1, int(MOST * len(numbers))), None
    still = numbers[sd <= AS_EXPECTED]
    for n in range(2, LARGEST_SHARE + 1):
        offset = np.bincount((still if still.size else numbers) % n).argmax()
        f = ((numbers - offset) % n) / n
        expected = n * np.sqrt(n / (n - 1) * f * (1.0 - f))
        fits = np.abs(sd - expected) <= AS_EXPECTED * n
        if fits.sum() > best and len(np.unique(f[fits])) >= FEWEST_STILL:
            best, share = int(fits.sum()), n
    return share


def _share(numbers: npt.NDArray[np.int64]) -> int:
    """Return how many times coarser the grid of the samples is than that of their averages."""
    best, share, kept = EXCESS, 1, 0
    for n in range(2, LARGEST_SHARE + 1):
        counts = np.bincount(numbers % n)
        on, chance = int(counts.max()), len(numbers) / n
        excess = (on - chance) / np.sqrt(chance)
        is_multiple = share > 1 and n % share == 0
        if on < MOST * len(numbers) or excess <= best or (is_multiple and on < KEEPS * kept):
            continue
        if len(np.unique(numbers[numbers % n == counts.argmax()])) >= FEWEST_STILL:
            best, share, kept = excess, n, on
    return share


def _finding(target: str, step: float, of: Iterable[Channel]) -> Finding:
    of = tuple(of)
    names, unit = tuple(c.name for c in of), of[0].unit
    stated = float(np.sqrt(np.nanmedian(of[0].variance)))
    return Finding(
        "quantisation",
        target,
        Change("quantisation", target, {"channels": names, "step": step}),
        f"{target} {', '.join(names)}: readings lie on a grid of {step:.3g} {unit}, an error of "
        f"{step / np.sqrt(12.0):.2g} {unit} where {stated:.2g} {unit} is stated",
        (),
        "step^2 / 12 added to the variance",
        "read the sensor at its full resolution, or state its error",
    )
