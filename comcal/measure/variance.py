# SPDX-License-Identifier: Apache-2.0
"""From standard errors of single windows to the variances that weights are made of.

A standard error estimated within one short window is itself uncertain: from n effective samples
its square scatters by a factor 1 +/- sqrt(2/n). Weights made of such numbers favour the poses that
looked quiet by chance, which costs accuracy and makes intervals too short. All poses of a channel
therefore share one pooled variance, except a pose that was plainly noisier than the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from comcal.errors import DataError
from comcal.robot.tree import Array

OUTLIER_RATIO = 9.0
"""A pose whose squared standard error exceeds that of the others by more keeps its own: three times
their noise. Among equally noisy poses with only four effective samples each this happens by chance
once in 40 000 poses (F(3, 100))."""

DEAD_FRACTION = 1e-4
"""A pooled standard error below this part of what robot.yaml states is not noise but a constant:
the last digit of a quantised or simulated channel. The stated value is used then."""

MIN_REPEATS = 6
"""Degrees of freedom from which on repeated poses tell the pose-to-pose scatter."""


def pooled_variance(
    standard_errors: npt.ArrayLike, ratio: float = OUTLIER_RATIO
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return the variance of each pose mean of one channel.

    Parameters
    ----------
    standard_errors : array, shape (N,)
        Of the pose means, from within their windows; NaN where not given.
    ratio : float
        How many times the pooled variance of the others a pose must exceed to keep its own.

    Returns
    -------
    variance : array, shape (N,)
        The mean of the squared standard errors, or the pose's own for an outlier; the pooled one
        where none was given; all NaN where none is given at all.
    own : array of bool, shape (N,)
        Which poses keep their own.

    Notes
    -----
    The quietest half starts the pool; poses join it in order of noise until one exceeds *ratio*
    times the mean of those already in. So up to half of the poses may be outliers without hiding
    one another.

    Examples
    --------
    >>> pooled_variance([1.0, 1.2, 0.8, 10.0])[0].round(3).tolist()
    [1.027, 1.027, 1.027, 100.0]
    """
    squares = np.asarray(standard_errors, dtype=np.float64) ** 2
    given = np.flatnonzero(np.isfinite(squares))
    own = np.zeros(squares.shape, dtype=np.bool_)
    if given.size == 0:
        return np.full(squares.shape, np.nan), own
    order = given[np.argsort(squares[given], kind="stable")]
    n_pool = (order.size + 1) // 2
    while n_pool < order.size:
        pooled = squares[order[:n_pool]].mean()
        if pooled > 0.0 and squares[order[n_pool]] > ratio * pooled:
            break
        n_pool += 1
    own[order[n_pool:]] = True
    return np.where(own, squares, squares[order[:n_pool]].mean()), own


def channel_variance(
    standard_errors: npt.ArrayLike, stated: float
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return pooled variances, or the square of *stated* where the windows tell nothing.

    Parameters
    ----------
    standard_errors : array, shape (N,)
        NaN where not given.
    stated : float
        Standard error of a pose mean by robot.yaml, used when no pose has one or when the pooled
        one is smaller than ``DEAD_FRACTION`` of it.

    Returns
    -------
    variance : array, shape (N,)
    own : array of bool, shape (N,)
        As of :func:`pooled_variance`.
    """
    variance, own = pooled_variance(standard_errors)
    is_dead = ~(np.sqrt(variance) >= DEAD_FRACTION * stated)
    return np.where(is_dead, stated**2, variance), own & ~is_dead


def assemble_covariance(
    variance: Array, off_diagonal: Array, own: npt.NDArray[np.bool_], where: str
) -> Array:
    """Return one covariance matrix per pose from variances and window covariances.

    Parameters
    ----------
    variance : array, shape (N, C)
        Used variance of each pose and channel; NaN for absent channels.
    off_diagonal : array, shape (N, C, C)
        Covariances of the means within their windows (diagonal: squared standard errors); NaN
        where not given.
    own : array of bool, shape (N, C)
        Channels that keep the variance of their own window.
    where : str
        File and sensor, for messages.

    Returns
    -------
    cov : array, shape (N, C, C)
        Positive semidefinite; NaN in the rows and columns of absent channels.

    Raises
    ------
    DataError
        If the covariances given cannot be those of any variables.

    Notes
    -----
    Correlations are pooled over the poses with usual noise, for the same reason as variances, and
    then scaled by the variances of each pose; that keeps every matrix positive semidefinite.
    """
    n_channels = variance.shape[1]
    usual = ~own.any(axis=1)
    window = np.where(np.isfinite(off_diagonal), off_diagonal, 0.0)
    pooled = window[usual if usual.any() else slice(None)].mean(axis=0)
    scale = np.sqrt(np.where(np.diag(pooled) > 0.0, np.diag(pooled), 1.0))
    correlation = pooled / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    smallest = float(np.linalg.eigvalsh(correlation)[0])
    if smallest < -1e-6:
        raise DataError(
            "the covariances between channels are larger than the standard errors allow",
            where=where,
            measured=f"smallest eigenvalue of the correlation {smallest:.3g}",
            limit="0",
            next_step="give covariances of the mean (not of single samples), or leave cov.* out",
        )
    sigma = np.sqrt(variance)
    return sigma[:, :, None] * correlation.reshape(1, n_channels, n_channels) * sigma[:, None, :]


def revisit_variance(
    values: Array, window_variance: Array, groups: Sequence[str]
) -> tuple[float, int]:
    """Estimate the scatter between visits of the same pose that windows cannot show.

    Parameters
    ----------
    values : array, shape (N, C)
        Pose means of channels of one kind; NaN where absent.
    window_variance : array, shape (N, C)
        Their variances from within the windows.
    groups : sequence of str, length N
        Poses of equal, non-empty text are repeats of one another.

    Returns
    -------
    variance : float
        Mean square within groups less the windows' own variance, not below zero.
    freedom : int
        Degrees of freedom it rests on; below ``MIN_REPEATS`` it should not be used.
    """
    squares, expected, freedom = 0.0, 0.0, 0
    labels = np.asarray(groups, dtype=object)
    for group in sorted({g for g in groups if g}):
        member = labels == group
        for v, var in zip(values[member].T, window_variance[member].T, strict=True):
            there = np.isfinite(v)
            n = int(there.sum())
            if n > 1:
                squares += float(((v[there] - v[there].mean()) ** 2).sum())
                expected += float(var[there].mean()) * (n - 1)
                freedom += n - 1
    if freedom == 0:
        return 0.0, 0
    return max(0.0, (squares - expected) / freedom), freedom
