# SPDX-License-Identifier: Apache-2.0
"""Is the robot standing still, and since when?

Cotton (2009), section on the human experiment: the centre of pressure (CoP) is tracked for five
seconds; if its standard deviation stays below one millimetre for at least 200 ms, the posture is
static. A slow sway passes that at its turning points, where it stands still for an instant;
therefore two tests are added: the straight line through the window, and how far the moving mean
has wandered during the second before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.cop import CenterOfPressure, centers_of_pressure
from comcal.measure.source import Block
from comcal.robot.model import Robot
from comcal.robot.tree import Array

Mask = npt.NDArray[np.bool_]

MM = ("mm", 1e3)

LARGEST_GAP = 1.5
"""A window may last this much longer than its samples need; more of them were lost."""

BURST = 0.1
"""Stamps that are closer than this part of their mean spacing tell when samples were fetched."""


@dataclass(frozen=True)
class StillCriterion:
    """When a robot counts as standing still.

    Parameters
    ----------
    cop_sd : float
        Largest standard deviation of each component of the CoP within the window [m].
    window : float
        Length of the window that is averaged [s].
    timeout : float
        How long to wait for such a window after moving [s], in the clock of the source.
    drift : float
        Largest change of the CoP along the straight line through the window, and largest
        excursion of its moving mean during ``settle`` [m].
    settle : float
        How long the moving mean must have stayed at its place when the window ends [s];
        zero leaves Cotton's criterion and the straight line.
    min_samples : int
        The window is lengthened until it has as many samples.
    min_force : float
        Below this normal force nobody stands on the feet [N].
    arrival : float
        Largest distance of each joint from its planned position [rad] or [m].
    q_sd, force_sd, moment_sd : float
        Largest standard deviations (and drifts) of every joint [rad] or [m] and wrench channel
        [N], [N m], instead of the CoP where no measured foot carries the robot.
    """

    cop_sd: float = 1e-3
    window: float = 0.2
    timeout: float = 5.0
    drift: float = 1e-3
    settle: float = 1.0
    min_samples: int = 25
    min_force: float = 10.0
    arrival: float = 0.05
    q_sd: float = 1e-3
    force_sd: float = 1.0
    moment_sd: float = 0.1


@dataclass(frozen=True)
class Stillness:
    """What :func:`judge_stillness` found.

    Parameters
    ----------
    window : slice or None
        Samples of the still window; None when there is none.
    what, measured, limit : str
        Without a window: the test that the newest window failed, and its numbers.
    """

    window: slice | None
    what: str = ""
    measured: str = ""
    limit: str = ""

    @property
    def reason(self) -> str:
        """What failed, in one phrase; empty for a still robot."""
        numbers = f" ({self.measured}, limit {self.limit})" if self.limit else ""
        return f"{self.what}{numbers}"


def find_still_window(
    block: Block, robot: Robot, support: str, criterion: StillCriterion
) -> slice | None:
    """Return the latest window of *block* in which the robot stands still, or None.

    The latest, because a robot that settles is stiller later. See :func:`judge_stillness`.
    """
    return judge_stillness(block, robot, support, criterion).window


def judge_stillness(
    block: Block, robot: Robot, support: str, criterion: StillCriterion
) -> Stillness:
    """Look for the latest still window, and say what is wrong when there is none.

    Parameters
    ----------
    block : Block
        Samples since the last motion; or the newest ``settle + window`` seconds of them.
    robot : Robot
    support : str
        ``double``, ``none`` or the foot that stands; says which sensors are loaded.
    criterion : StillCriterion

    Returns
    -------
    Stillness

    Notes
    -----
    A window passes when every signal has a standard deviation below its limit, changes by less
    than its limit along the straight line of least squares, and when its moving mean over windows
    of the same length stayed within the drift limit during the ``settle`` seconds that end with
    this window. Samples that are not finite, or lost ones, spoil every window they fall into.
    """
    length = window_length(block.t, criterion)
    if length is None:
        wanted = _wanted_length(block.t, criterion)
        return Stillness(None, "too few samples", f"{block.t.size}", f"{wanted}")
    tests = _tests(block, robot, support, criterion, length)
    passed = np.ones(block.t.size - length + 1, dtype=np.bool_)
    for test in tests:
        passed &= test.values <= test.limit  # NaN does not pass
    if passed.any():
        start = int(np.flatnonzero(passed)[-1])
        return Stillness(slice(start, start + length))
    return _explain(tests)


@dataclass(frozen=True)
class Motion:
    """How much one signal moves now; all numbers in ``unit``.

    Parameters
    ----------
    name, unit : str
    sd, sd_limit : float
        Standard deviation within the newest window.
    drift, drift_limit : float
        The larger of its change along the straight line and of the wandering of its moving mean.
    """

    name: str
    unit: str
    sd: float
    sd_limit: float
    drift: float
    drift_limit: float

    @property
    def excess(self) -> float:
        """The larger of both numbers over its limit; above 1 the signal is not still."""
        return float(max(self.sd / self.sd_limit, self.drift / self.drift_limit))


def newest_motion(
    block: Block, robot: Robot, support: str, criterion: StillCriterion
) -> tuple[Motion, ...]:
    """Return how much everything moves in the newest window, what moves most first.

    Parameters
    ----------
    block : Block
    robot : Robot
    support : str
    criterion : StillCriterion

    Returns
    -------
    tuple of Motion
        Empty where *block* is too short for a window. A signal that is not finite has NaN.
    """
    length = window_length(block.t, criterion)
    if length is None:
        return ()
    count = _settle_count(block.t, criterion, length)
    found: list[Motion] = []
    for s in _signals(block, robot, support, criterion, length):
        mean, sd, change = _rolling(s.values, length)
        wandering = float(np.ptp(mean[-count:]))
        drift = max(abs(float(change[-1])), wandering) if np.isfinite(wandering) else np.nan
        k = s.scale
        found.append(Motion(s.name, s.unit, k * float(sd[-1]), k * s.sd, k * drift, k * s.drift))
    return tuple(sorted(found, key=lambda m: -np.nan_to_num(m.excess, nan=np.inf)))


def window_length(t: Array, criterion: StillCriterion) -> int | None:
    """Return the number of samples of a window, or None when *t* is too short for one.

    Parameters
    ----------
    t : array, shape (n,)
        Times of the samples [s].
    criterion : StillCriterion
    """
    length = _wanted_length(t, criterion)
    return length if length <= t.size else None


def _wanted_length(t: Array, criterion: StillCriterion) -> int:
    """Return the number of samples that a window needs."""
    least = max(criterion.min_samples, 2)
    if t.size < 2:
        return least
    period = _period(t)
    if not period > 0.0:
        return t.size + 1
    # A millionth of a sample of slack: 0.2 s / 8 ms is 25, not 26 for a rounding error.
    return max(int(np.ceil(criterion.window / period - 1e-6)), least)


def _period(t: Array) -> float:
    """Return how far samples are apart [s]: the median, which does not mind that some were lost."""
    median = float(np.median(np.diff(t)))
    mean = float(t[-1] - t[0]) / (t.size - 1)
    # Samples that a busy computer took from its adapter at once bear almost the same stamp.
    return median if median > BURST * mean else mean


@dataclass(frozen=True)
class _Signal:
    """One number per sample that must not move: ``values`` (n,), its limits, its unit in words."""

    name: str
    values: Array
    sd: float
    drift: float
    unit: str
    scale: float = 1.0


@dataclass(frozen=True)
class _Test:
    """One number per window, in the order of their first samples, against a limit; of whom."""

    what: str
    values: Array
    limit: float
    unit: str
    scale: float = 1.0
    of: str = ""


def _tests(
    block: Block, robot: Robot, support: str, criterion: StillCriterion, length: int
) -> list[_Test]:
    """Return all tests; those that explain the failure of others come first."""
    t = block.t
    period = _period(t)
    lasts = t[length - 1 :] - t[: t.size - length + 1]
    tests = [
        _Test("samples were lost: the window lasts", lasts, LARGEST_GAP * period * length, "s")
    ]
    cops = centers_of_pressure(block, robot, support, length)
    for cop in cops:
        lacking = criterion.min_force - _rolling(cop.force, length)[0]
        of = " + ".join(cop.sensors)
        what = f"{of} must carry {criterion.min_force:g} N, lacking are"
        tests.append(_Test(what, lacking, 0.0, "N", of=of))
    signals = _signals_of(cops, criterion) or _raw(block, robot, criterion)
    rolled = [(s, *_rolling(s.values, length)) for s in signals]
    count = _settle_count(t, criterion, length)
    for s, _, sd, _ in rolled:
        tests.append(_Test(f"standard deviation of {s.name}", sd, s.sd, s.unit, s.scale, s.name))
    for s, _, _, change in rolled:
        tests.append(_Test(f"drift of {s.name}", np.abs(change), s.drift, s.unit, s.scale, s.name))
    for s, mean, _, _ in rolled:
        wandering = _excursion(mean, count)
        tests.append(_Test(f"wandering of {s.name}", wandering, s.drift, s.unit, s.scale, s.name))
    return tests


def _signals(
    block: Block, robot: Robot, support: str, criterion: StillCriterion, length: int
) -> list[_Signal]:
    cops = centers_of_pressure(block, robot, support, length)
    return _signals_of(cops, criterion) or _raw(block, robot, criterion)


def _signals_of(cops: Sequence[CenterOfPressure], criterion: StillCriterion) -> list[_Signal]:
    """Return the components of the centres of pressure."""
    return [
        _Signal(f"CoP {a} of {' + '.join(c.sensors)}", xy, criterion.cop_sd, criterion.drift, *MM)
        for c in cops
        for a, xy in zip("xy", c.xy.T, strict=True)
    ]


def _settle_count(t: Array, criterion: StillCriterion, length: int) -> int:
    """Return how many windows in a row must not wander."""
    return max(round(criterion.settle / _period(t)) - length + 1, 1)


def _raw(block: Block, robot: Robot, criterion: StillCriterion) -> list[_Signal]:
    """Return what must not move when nothing that is measured carries the robot."""
    names = robot.tree.joint_names
    found = [
        _Signal(f"q of {joint}", values, criterion.q_sd, criterion.q_sd, "mrad (or mm)", 1e3)
        for joint, values in zip(names, block.q.T, strict=True)
    ]
    for sensor, wrench in block.wrenches.items():
        for k, values in enumerate(wrench.T):
            limit, unit = (criterion.force_sd, "N") if k < 3 else (criterion.moment_sd, "N m")
            name = f"{'force' if k < 3 else 'moment'} {'xyz'[k % 3]} of {sensor}"
            found.append(_Signal(name, values, limit, limit, unit))
    return found


def _rolling(x: Array, length: int) -> tuple[Array, Array, Array]:
    """Return mean, standard deviation and change along the fitted line, shape (n - length + 1,)."""
    finite = np.isfinite(x)
    centre = float(x[finite].mean()) if finite.any() else 0.0
    y = np.where(finite, x - centre, 0.0)  # about the centre: sums of squares cancel less
    k = np.arange(y.size, dtype=np.float64)
    total, squares, ramp, bad = (
        _window_sums(v, length) for v in (y, y * y, k * y, (~finite).astype(np.float64))
    )
    mean = total / length
    variance = np.maximum(squares - total * mean, 0.0) / (length - 1)
    middle = k[: mean.size] + 0.5 * (length - 1)
    slope = (ramp - middle * total) * 12.0 / (length * (length**2 - 1.0))
    hole = np.where(bad > 0.5, np.nan, 0.0)
    return mean + centre + hole, np.sqrt(variance) + hole, slope * (length - 1) + hole


def _window_sums(x: Array, length: int) -> Array:
    sums = np.concatenate([[0.0], np.cumsum(x)])
    return sums[length:] - sums[:-length]


def _excursion(mean: Array, count: int) -> Array:
    """Return max - min of the last *count* moving means; infinite before there are as many."""
    excursion = np.full(mean.size, np.inf)
    if mean.size >= count:
        windows = np.lib.stride_tricks.sliding_window_view(mean, count)
        excursion[count - 1 :] = windows.max(axis=1) - windows.min(axis=1)
    return excursion


def _explain(tests: list[_Test]) -> Stillness:
    """Say which test the newest window failed."""
    for test in tests:
        value = float(test.values[-1])
        if np.isinf(value):
            break
        if np.isnan(value):
            return Stillness(None, f"samples of {test.of or test.what} are missing")
        if value > test.limit:
            measured, limit = (f"{x * test.scale:.3g} {test.unit}" for x in (value, test.limit))
            return Stillness(None, test.what, measured, limit)
    return Stillness(None, "not read for long enough")
