# SPDX-License-Identifier: Apache-2.0
r"""How large the largest of many slopes may be if noise made them all.

Each of C channels has n slopes of white noise, in units of a standard deviation that is one and the
same for all channels and not known. It is judged by the k-th smallest of the C spreads. The channel
looked at competes with the k-th smallest a of the C - 1 others, whose chance of lying below is a
beta variable, so the chance that any of m numbers exceeds L times the noise is at most

.. math:: m \int_0^1 S(L\,a(p))\,\mathrm{d}p, \qquad a(p) = Q(I^{-1}_{k,\,C-k}(p)),

with the chance S that one number exceeds a limit, the quantiles Q of the spread of one channel, and
the quantiles I^-1 of the beta distribution. L is where that is the false-alarm rate allowed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq
from scipy.stats import beta, chi2, norm

from comcal.robot.tree import Array

FALSE_ALARMS = 5e-4
"""Of a whole table, by each of the two limits."""
QUIETER = 0.25
"""Part of the channels by which noise is judged: a robot that moves does not move all of them."""
MAD = 0.6745
"""Median of the size of a standard normal number."""
_EDGES = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 400)])
_WIDEST = 1e6


def noise_of(spreads: Array) -> float:
    """Return the noise that all channels share, from the spread of each, shape (C,)."""
    return float(np.sort(spreads)[_rank(len(spreads)) - 1])


def mean_square_limit(n: int, fewest: int, channels: int) -> float:
    """Return which mean square of slopes no channel of noise exceeds, in squares of the noise.

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
        return chi2.sf(n * x, n)

    return _limit(channels, channels, exceeds, lambda p: chi2.ppf(p, fewest) / fewest)


def largest_limit(n: int, fewest: int, channels: int) -> float:
    """Return which size no single slope of noise exceeds, in units of the noise.

    Parameters
    ----------
    n, fewest, channels : int
        As in :func:`mean_square_limit`.

    Returns
    -------
    float
        For noise judged by medians of sizes; infinite for one channel alone.
    """
    lower_middle = (fewest - 1) // 2 + 1

    def typical(p: Array) -> Array:
        below = beta.ppf(p, lower_middle, fewest - lower_middle + 1)
        return norm.isf(0.5 * (1.0 - below)) / MAD

    return _limit(channels, n * channels, lambda x: 2.0 * norm.sf(x), typical)


def _rank(channels: int) -> int:
    return int(np.ceil(QUIETER * channels))


def _limit(
    channels: int, numbers: int, exceeds: Callable[[Array], Array], quantile: Callable[[Array], Array]
) -> float:
    if channels < 2:
        return np.inf
    k = _rank(channels)
    p = 0.5 * (_EDGES[1:] + _EDGES[:-1])
    noise = quantile(beta.ppf(p, k, channels - k))

    def excess(log_limit: float) -> float:
        chance = numbers * float(np.diff(_EDGES) @ exceeds(np.exp(log_limit) * noise))
        return float(np.log(max(chance, 1e-300) / FALSE_ALARMS))

    return float(np.exp(brentq(excess, 0.0, np.log(_WIDEST))))
