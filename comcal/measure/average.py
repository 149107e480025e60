# SPDX-License-Identifier: Apache-2.0
"""Averaging a still window: the mean, and how far it can be trusted.

Neighbouring samples of a filtered sensor repeat one another, so the mean of n samples is less
certain than sd / sqrt(n). Averaging over blocks that are longer than this memory makes them
independent again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.robot.tree import Array

FEWEST_BLOCKS = 8
"""Blocks that must remain: the standard error of fewer is itself hardly known."""

MOST_CORRELATED = 0.6
"""Largest lag-1 correlation corrected for: an estimate from eight blocks may not run away."""

SIGNIFICANCE_Z = 2.326
"""One-sided 1 %: how clearly blocks must be correlated before longer ones are taken."""


@dataclass(frozen=True)
class WindowMean:
    """Mean of n samples of k channels.

    Parameters
    ----------
    mean : array, shape (k,)
        In the unit of the samples, like ``standard_error`` and ``sd``.
    standard_error : array, shape (k,)
        Of the mean, autocorrelation included; NaN for a single sample.
    sd : array, shape (k,)
        Standard deviation of the single samples; NaN for a single sample.
    slope : array, shape (k,)
        Drift per second, from the straight line of least squares; NaN for a single sample.
    effective_n : float
        Number of independent samples that would give the same standard error (median over the
        channels that vary at all).
    block : int
        Length of the blocks, in samples; 1 where no autocorrelation was found.
    """

    mean: Array
    standard_error: Array
    sd: Array
    slope: Array
    effective_n: float
    block: int


def average(t: npt.ArrayLike, samples: npt.ArrayLike) -> WindowMean:
    """Average one window of the channels of one instrument.

    Parameters
    ----------
    t : array, shape (n,)
        Times [s], increasing.
    samples : array, shape (n, k)
        Channels that share one filter, hence one memory: the six of a force sensor, the encoders.

    Returns
    -------
    WindowMean

    Notes
    -----
    Blocks of 1, 2, 4, ... samples (Flyvbjerg and Petersen 1989, J. Chem. Phys. 91, 461). The first
    length is taken whose block means show no significant positive lag-1 correlation rho; the test
    pools all channels, since 25 samples of one channel would not reveal a memory of two samples.
    What correlation blocks still have multiplies the variance of their mean by
    (1 + rho) / (1 - rho), with the small-sample biases of rho and of the variance removed.

    White noise is left alone: its squared standard error is unbiased with 24 degrees of freedom for
    25 samples, apart from the 1 % of windows in which the test errs (upwards). What is *not* seen
    is a memory longer than about an eighth of the window: such a drift shows in ``slope``.

    Examples
    --------
    >>> average([0.0, 0.1, 0.2, 0.3], [[1.0], [3.0], [1.0], [3.0]]).mean.tolist()
    [2.0]
    """
    x = np.asarray(samples, dtype=np.float64)
    n = x.shape[0]
    mean = x.mean(axis=0)
    if n < 2:
        unknown = np.full(mean.shape, np.nan)
        return WindowMean(mean, unknown, unknown, unknown, float(n), 1)
    deviations = x - mean
    sd = np.sqrt((deviations**2).sum(axis=0) / (n - 1))
    block, memory = _block_length(deviations)
    means = _block_means(deviations, block)
    # The variance of a mean of `block` samples, scaled to the mean of all n of them.
    standard_error = np.sqrt(memory * means.var(axis=0, ddof=1) * block / n)
    varies = (sd > 0.0) & (standard_error > 0.0)
    ratio = (sd[varies] / standard_error[varies]) ** 2
    effective_n = float(np.clip(np.median(ratio), 1.0, n)) if ratio.size else float(n)
    return WindowMean(mean, standard_error, sd, _slope(t, deviations), effective_n, block)


def _block_length(deviations: Array) -> tuple[int, float]:
    """Return the shortest block whose means are uncorrelated, and the factor for what remains."""
    block, (rho, is_correlated) = 1, _lag_one(deviations)
    while is_correlated and deviations.shape[0] // (2 * block) >= FEWEST_BLOCKS:
        block *= 2
        rho, is_correlated = _lag_one(_block_means(deviations, block))
    if block == 1 and not is_correlated:
        return 1, 1.0
    m = deviations.shape[0] // block
    rho = float(np.clip((m * rho + 1.0) / (m - 4.0), 0.0, MOST_CORRELATED))
    memory = (1.0 + rho) / (1.0 - rho)
    return block, memory * (m - 1.0) / (m - memory)


def _block_means(x: Array, block: int) -> Array:
    """Return the means of consecutive blocks; the first few samples may be left over."""
    count = x.shape[0] // block
    return x[x.shape[0] - count * block :].reshape(count, block, -1).mean(axis=1)


def _lag_one(x: Array) -> tuple[float, bool]:
    """Return the lag-1 autocorrelation, all columns together, and whether it is significant.

    That of n independent normal numbers has mean -1/n and variance (n - 2)^2 / (n^2 (n - 1))
    (Moran 1948, Biometrika 35, 255).
    """
    n = x.shape[0]
    x = x - x.mean(axis=0)
    power = (x**2).sum(axis=0)
    varies = power > 0.0
    if n < FEWEST_BLOCKS or not varies.any():
        return 0.0, False
    r = (x[1:] * x[:-1]).sum(axis=0)[varies] / power[varies]
    spread = (n - 2) / (n * np.sqrt(n - 1.0))
    return float(r.mean()), bool((r + 1.0 / n).sum() > SIGNIFICANCE_Z * spread * np.sqrt(r.size))


def _slope(t: npt.ArrayLike, deviations: Array) -> Array:
    # Relative to the first sample, so that the same window gives the same slope at any hour.
    times = np.asarray(t, dtype=np.float64)
    times = times - times[0]
    times = times - times.mean()
    return times @ deviations / (times @ times)
