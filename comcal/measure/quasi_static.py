# SPDX-License-Identifier: Apache-2.0
"""From a slow, continuous motion to poses that may be treated as static, and what that costs.

The slowest windows are chosen, spread over the postures that occur; the wrench that statics
neglects (:mod:`comcal.measure.inertia`) becomes part of the standard error of each mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from comcal.errors import DataError
from comcal.robot.tree import Array

LAG = 0.02
"""Time by which joint angles and forces of a logger may be apart [s]: weighs velocity."""
HEIGHT_OVER_GRAVITY = 0.1
"""Height of a CoM over g [s^2]: what an angular acceleration does to the centre of pressure, as an
angle of the body; weighs acceleration against velocity."""
JITTER = 0.05
"""Relative irregularity of the sampling interval that a differentiating filter tolerates; times
that scatter by more are interpolated to regular ones."""
LONGEST_GAP = 5.0
"""Gaps of so many sampling intervals are not interpolated: the robot may have done anything."""


@dataclass(frozen=True)
class QuasiStatic:
    """How windows are chosen.

    Parameters
    ----------
    window : float
        Length of a window [s].
    spread : float
        Postures nearer to one another than this in every joint [rad or m] count as the same.
    per_posture : int
        Windows kept of the same posture.
    most : int
        Windows kept in all.
    smoothing : float
        Length of the Savitzky-Golay filter that differentiates positions [s].
    stuck : float
        A force sensor that repeats all its channels for so long has stopped [s].
    """

    window: float = 0.2
    spread: float = 0.1
    per_posture: int = 2
    most: int = 60
    smoothing: float = 0.3
    stuck: float = 0.2


def differentiate(t: Array, q: Array, smoothing: float) -> tuple[Array, Array]:
    """Return velocities and accelerations by a Savitzky-Golay filter.

    Parameters
    ----------
    t : array, shape (n,)
        Sampling times [s], nearly regular.
    q : array, shape (n, k)
    smoothing : float
        Length of the filter [s], at least five samples; cubic polynomials.

    Returns
    -------
    qd, qdd : array, shape (n, k)

    Raises
    ------
    DataError
        If sampling is irregular or the log is shorter than the filter.

    References
    ----------
    Savitzky, Golay (1964), Anal. Chem. 36(8), 1627.
    """
    dt = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    if dt > 0.0 and JITTER * dt < np.abs(np.diff(t) - dt).max() < (LONGEST_GAP - 1.0) * dt:
        regular = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt) + 1)
        found = differentiate(regular, _interpolated(regular, t, q), smoothing)
        return _interpolated(t, regular, found[0]), _interpolated(t, regular, found[1])
    if not dt > 0.0 or np.abs(np.diff(t) - dt).max() > JITTER * dt:
        raise DataError(
            "positions are not sampled regularly, so they cannot be differentiated",
            measured=f"intervals of {np.diff(t).min(initial=0.0):.4g} s"
            f" to {np.diff(t).max(initial=0.0):.4g} s",
            next_step="map the columns qd.* and qdd.*, or resample the log",
        )
    n = max(5, 2 * round(0.5 * smoothing / dt) + 1)
    if n > t.size:
        raise DataError(
            "the log is too short to be differentiated",
            measured=f"{t.size} samples",
            limit=f"{n} samples",
            next_step="map the columns qd.* and qdd.*, or shorten `smoothing`",
        )
    half = n // 2
    x = dt * np.arange(-half, half + 1)
    fit = np.linalg.pinv(np.vander(x, 4, increasing=True))
    windows = np.lib.stride_tricks.sliding_window_view(q, n, axis=0)
    # Coefficients of the cubic around each sample; the first and last windows serve both ends.
    cubic = np.einsum("cn,mkn->mkc", fit, windows)[np.clip(np.arange(t.size) - half, 0, t.size - n)]
    s = np.zeros(t.size)
    s[:half], s[t.size - half :] = x[:half], x[half + 1 :]
    s = s[:, None]
    qd = cubic[..., 1] + 2.0 * cubic[..., 2] * s + 3.0 * cubic[..., 3] * s**2
    qdd = 2.0 * cubic[..., 2] + 6.0 * cubic[..., 3] * s
    return qd, qdd


def _interpolated(at: Array, t: Array, values: Array) -> Array:
    return np.column_stack([np.interp(at, t, column) for column in values.T])


def motion_score(qd: Array, qdd: Array) -> Array:
    """Return how far from static each sample is, as an angle [rad], shape (n,).

    ``LAG |qd| + HEIGHT_OVER_GRAVITY |qdd|``: the error of posture by what may be unsynchronised,
    and the lean that would move the centre of pressure as the acceleration does.

    Parameters
    ----------
    qd, qdd : array, shape (n, n_joints)
    """
    return LAG * np.linalg.norm(qd, axis=1) + HEIGHT_OVER_GRAVITY * np.linalg.norm(qdd, axis=1)


def slowest_windows(
    t: Array,
    q: Array,
    qd: Array,
    qdd: Array,
    labels: tuple[str, ...],
    options: QuasiStatic,
    usable: npt.NDArray[np.bool_] | None = None,
) -> tuple[slice, ...]:
    """Choose the windows that are nearest to static, spread over postures, in order of time.

    Parameters
    ----------
    t : array, shape (n,)
        [s].
    q, qd, qdd : array, shape (n, n_joints)
    labels : tuple of str, length n
        A window never spans two different labels (supports, stances).
    options : QuasiStatic
    usable : array of bool, shape (n,), optional
        A window holds no other samples; by default all are.

    Raises
    ------
    DataError
        If the log, or every usable stretch of it, is shorter than one window.
    """
    score = motion_score(qd, qdd) ** 2
    total = np.concatenate([[0.0], np.cumsum(score)])
    changes = np.concatenate([[0], np.cumsum([a != b for a, b in pairwise(labels)])])
    starts = np.arange(t.size)
    ends = np.searchsorted(t, t + options.window * (1.0 - 1e-9))
    whole = (t[-1] - t >= options.window * (1.0 - 1e-9)) & (ends - starts >= 2)
    whole &= changes[np.minimum(ends, t.size) - 1] == changes[starts]
    if usable is not None:
        unusable = np.concatenate([[0], np.cumsum(~usable)])
        whole &= unusable[ends] == unusable[starts]
    starts, ends = starts[whole], ends[whole]
    if not starts.size:
        raise DataError(
            "the log is shorter than one window",
            measured=f"{np.ptp(t):.3g} s",
            limit=f"{options.window:.3g} s",
            next_step="log longer, or give a shorter `window` in the map",
        )
    mean_score = (total[ends] - total[starts]) / (ends - starts)
    chosen: list[slice] = []
    postures: list[Array] = []
    for i in np.argsort(mean_score, kind="stable"):
        window = slice(int(starts[i]), int(ends[i]))
        if any(window.start < w.stop and w.start < window.stop for w in chosen):
            continue
        posture = q[window].mean(axis=0)
        near = sum(bool(np.all(np.abs(posture - p) < options.spread)) for p in postures)
        if near >= options.per_posture:
            continue
        chosen.append(window)
        postures.append(posture)
        if len(chosen) == options.most:
            break
    return tuple(sorted(chosen, key=lambda w: w.start))
