# SPDX-License-Identifier: Apache-2.0
r"""How large the largest of many slopes may be where noise made them all.

Each of C channels has slopes of white noise, in units of a standard deviation that all channels
share and nobody knows: it is judged by the k-th smallest of their spreads. The k-th smallest a of m
independent spreads lies below its quantile a(p) with the chance that a beta variable lies below p,
so one of M numbers exceeds L times the noise with a chance of at most

.. math:: M \int_0^1 S(L\,a(p))\,\mathrm{d}p, \qquad a(p) = Q(I^{-1}_{k,\,m-k+1}(p)),

where S is the chance that one number exceeds a limit, Q the quantile of the spread of one channel
and I^-1 that of the beta distribution. L is where that equals the false-alarm rate allowed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import root_scalar
from scipy.stats import beta, chi2, norm

from comcal.robot.tree import Array

FALSE_ALARMS = 5e-4
"""Of a whole table, by each of the two limits."""
QUIETER = 0.25
"""Part of the channels by which noise is judged: a robot that moves does not move all of them."""
MAD = float(norm.isf(0.25))
"""Median of the size of a standard normal number."""
_EDGES = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 400)])
_WIDEST = 1e6


def shared_noise(spreads: Array) -> float:
    """Return the noise that all channels share, from the spread of each, shape (C,)."""
    return float(np.sort(spreads)[_rank(len(spreads)) - 1])


def mean_square_limit(n: int, fewest: int, channels: int) -> float:
    """Return which mean square of its slopes no channel of noise exceeds, in squares of the noise.

    Parameters
    ----------
    n : int
        Slopes of the channel.
    fewest : int
        Of any channel.
    channels : int

    Returns
    -------
    float
        For noise judged by root mean squares; infinite for one channel alone.
    """

    def exceeds(x: Array) -> Array:
        return np.asarray(chi2.sf(n * x, n))

    def quantile(p: Array) -> Array:
        return np.asarray(chi2.ppf(p, fewest)) / fewest

    # What exceeds the noise is not itself among the quieter ones.
    return _limit(channels, exceeds, quantile, _rank(channels), channels - 1)


def largest_limit(n: int, fewest: int, channels: int) -> float:
    """Return which size no single slope of noise exceeds, in units of the noise.

    Parameters
    ----------
    n : int
        Slopes of all channels together.
    fewest : int
        Of any channel.
    channels : int

    Returns
    -------
    float
        For noise judged by medians of sizes.
    """
    middle = (fewest + 1) // 2  # the lower one of two

    def exceeds(x: Array) -> Array:
        return 2.0 * np.asarray(norm.sf(x))

    def quantile(p: Array) -> Array:
        below = np.asarray(beta.ppf(p, middle, fewest - middle + 1))
        return np.asarray(norm.isf(0.5 * (1.0 - below))) / MAD

    return _limit(n, exceeds, quantile, _rank(channels), channels)


def _rank(channels: int) -> int:
    return int(np.ceil(QUIETER * channels))


def _limit(
    numbers: int,
    exceeds: Callable[[Array], Array],
    quantile: Callable[[Array], Array],
    rank: int,
    spreads: int,
) -> float:
    """Return what none of so many numbers exceeds; noise has this rank among the *spreads*."""
    if rank > spreads:
        return np.inf
    p = 0.5 * (_EDGES[1:] + _EDGES[:-1])
    noise = quantile(np.asarray(beta.ppf(p, rank, spreads - rank + 1)))

    def excess(log_limit: float) -> float:
        chance = numbers * float(np.diff(_EDGES) @ exceeds(np.exp(log_limit) * noise))
        return float(np.log(max(chance, 1e-300) / FALSE_ALARMS))

    found = root_scalar(excess, bracket=(0.0, float(np.log(_WIDEST))), method="brentq")
    return float(np.exp(found.root))
