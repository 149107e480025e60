# SPDX-License-Identifier: Apache-2.0
"""Are intervals as long as they should be, and estimates as good as the data allow?

Statistics of many calibrations whose truth is known. Quantities of one calibration share its
noise, so pooled numbers are judged by their scatter between calibrations, not by counting every
interval as independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import bdtr, ndtri

from comcal.robot.tree import Array

LEVEL = 0.95
"""Probability that an interval claims."""
Z = float(ndtri(0.5 + LEVEL / 2))


@dataclass(frozen=True)
class Trials:
    """Calibrations of one kind, and what is known about their truth.

    Parameters
    ----------
    kind : str
        Such as ``biped14, realistic``.
    names, units : tuple of str, length n
        Of the quantities.
    error, sigma : array, shape (N, n)
        Estimate minus truth, and the standard deviation claimed for it [kg], [m].
    reported : array of bool, shape (N, n)
        False where the calibration would have left the component out.
    bound : array, shape (n,)
        Cramer-Rao bound of the standard deviation; NaN where not given.
    chi2, dof : array, shape (N,)
        Misfit of every fit.
    ranks : array of int, shape (N,)
        Directions that every fit determined.
    failed : tuple of str
        What went wrong in calibrations that gave no result.
    """

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    error: Array
    sigma: Array
    reported: npt.NDArray[np.bool_]
    bound: Array
    chi2: Array
    dof: Array
    ranks: npt.NDArray[np.int_]
    failed: tuple[str, ...] = ()

    @property
    def covered(self) -> npt.NDArray[np.bool_]:
        """Whether each interval holds the truth, shape (N, n)."""
        return np.abs(self.error) <= Z * self.sigma


@dataclass(frozen=True)
class QuantityScore:
    """One quantity of one kind of calibration.

    Parameters
    ----------
    coverage : float
        Share of the intervals that hold the truth.
    band : tuple of (float, float)
        Where a right coverage lies, all quantities of the study together.
    bias : float
        Mean error in units of its own standard error: normal with sigma 1 if there is none.
    rms : float
        Root mean square error [kg], [m].
    efficiency : float
        ``rms`` over the Cramer-Rao bound; NaN without one.
    withheld : float
        Share of calibrations that would not have reported it.
    """

    kind: str
    name: str
    unit: str
    n: int
    coverage: float
    band: tuple[float, float]
    bias: float
    rms: float
    efficiency: float
    withheld: float

    @property
    def in_band(self) -> bool:
        """Whether the coverage is one that right intervals may well have."""
        return self.band[0] <= self.coverage <= self.band[1]


@dataclass(frozen=True)
class PooledScore:
    """All quantities of some calibrations together.

    Parameters
    ----------
    calibrations, intervals : int
    coverage : float
    interval : tuple of (float, float)
        Wilson's 95 % interval of the coverage.
    efficiency, efficiency_error : float
        Root mean square of error over bound, and its standard error; NaN without bounds.
    chi2_per_dof : float
    ranks : mapping from rank to number of calibrations
    """

    kind: str
    calibrations: int
    intervals: int
    coverage: float
    interval: tuple[float, float]
    efficiency: float
    efficiency_error: float
    chi2_per_dof: float
    ranks: dict[int, int]


def score_quantities(trials: Sequence[Trials], family_wise: float) -> tuple[QuantityScore, ...]:
    """Score every quantity of every kind of calibration.

    Parameters
    ----------
    trials : sequence of Trials
    family_wise : float
        Probability that right intervals keep *all* coverages within their bands.
    """
    count = sum(len(t.names) for t in trials)
    scores: list[QuantityScore] = []
    for t in trials:
        n = len(t.error)
        if n == 0:
            continue
        band = coverage_band(n, 1.0 - family_wise ** (1.0 / count))
        rms = np.sqrt(np.mean(t.error**2, axis=0))
        spread = np.sqrt(np.mean((t.error - t.error.mean(axis=0)) ** 2, axis=0))
        bias = t.error.mean(axis=0) / np.where(spread > 0.0, spread, np.inf) * np.sqrt(n)
        scores += [
            QuantityScore(
                kind=t.kind,
                name=name,
                unit=t.units[j],
                n=n,
                coverage=float(t.covered[:, j].mean()),
                band=band,
                bias=float(bias[j]),
                rms=float(rms[j]),
                efficiency=float(rms[j] / t.bound[j]),
                withheld=float(1.0 - t.reported[:, j].mean()),
            )
            for j, name in enumerate(t.names)
        ]
    return tuple(scores)


def score_pooled(trials: Sequence[Trials], kind: str) -> PooledScore:
    """Score all quantities of all calibrations of *trials* together.

    Parameters
    ----------
    trials : sequence of Trials
        With at least one calibration.
    kind : str
        What they are called.
    """
    covered = [t.covered for t in trials if t.error.size]
    hits = np.concatenate([c.sum(axis=1) for c in covered])
    sizes = np.concatenate([np.full(len(c), c.shape[1]) for c in covered])
    coverage = float(hits.sum() / sizes.sum())
    squares = np.concatenate([np.sum((t.error / t.bound) ** 2, axis=1) for t in trials])
    mean_square, its_error = _ratio(squares, sizes)
    efficiency = float(np.sqrt(mean_square))
    ranks = np.concatenate([t.ranks for t in trials])
    return PooledScore(
        kind=kind,
        calibrations=len(hits),
        intervals=int(sizes.sum()),
        coverage=coverage,
        interval=wilson_interval(coverage, _effective_count(hits, sizes, coverage)),
        efficiency=efficiency,
        efficiency_error=its_error / (2.0 * efficiency) if efficiency > 0 else its_error,
        chi2_per_dof=float(
            sum(t.chi2.sum() for t in trials) / max(1.0, sum(t.dof.sum() for t in trials))
        ),
        ranks={int(r): int(n) for r, n in zip(*np.unique(ranks, return_counts=True), strict=True)},
    )


def coverage_band(n: int, alpha: float) -> tuple[float, float]:
    """Return the smallest and largest share of *n* right 95 % intervals to be expected.

    Parameters
    ----------
    n : int
        Intervals.
    alpha : float
        Probability of a share outside, half of it on either side at most.
    """
    cumulative = bdtr(np.arange(n + 1), n, LEVEL)
    low = int(np.argmax(cumulative > alpha / 2))
    high = int(np.argmax(cumulative >= 1.0 - alpha / 2))
    return low / n, high / n


def wilson_interval(share: float, n: float) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a probability of which *share* was seen in *n* trials.

    Parameters
    ----------
    share : float
    n : float
        Independent trials; need not be whole.

    Examples
    --------
    >>> [round(end, 3) for end in wilson_interval(0.95, 400)]
    [0.924, 0.967]
    """
    centre = (share + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z * np.sqrt(share * (1 - share) / n + Z**2 / (4 * n**2)) / (1 + Z**2 / n)
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def _effective_count(hits: Array, sizes: Array, coverage: float) -> float:
    """Return how many independent intervals would scatter as much, at most all of them."""
    _, error = _ratio(hits, sizes)
    if not error > 0.0:
        return float(sizes.sum())
    return float(np.clip(coverage * (1 - coverage) / error**2, 1.0, sizes.sum()))


def _ratio(sums: Array, sizes: Array) -> tuple[float, float]:
    """Return the pooled mean of clusters and its standard error (linearised ratio)."""
    n = len(sums)
    mean = float(sums.sum() / sizes.sum())
    if n < 2:
        return mean, float("nan")
    left = sums - mean * sizes
    return mean, float(np.sqrt(n / (n - 1) * np.sum(left**2)) / sizes.sum())
