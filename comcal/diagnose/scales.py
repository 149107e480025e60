# SPDX-License-Identifier: Apache-2.0
"""By which factors the stated healthy tolerances are wrong, family by family.

A robot whose tolerances are stated too small looks broken everywhere; stated too large, its faults
hide. The likelihood of all residuals, with the best single cause allowed for, tells: first for all
families at once, then for each that has enough members to have a spread of its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from comcal.diagnose.evidence import all_log_odds
from comcal.diagnose.metric import Metric, metric, respread
from comcal.diagnose.scene import Scene

GRID = (0.25, 0.5, 1.0, 2.0, 4.0)
FAMILY_GRID = (1 / 3, 0.5, 2.0, 3.0, 4.5)
LARGEST = 4.5
"""A family that is further off than this is not healthy, whatever was stated."""
OVERALL = np.log(2.0)
"""Standard deviation of the logarithm of a factor, before anything is measured."""
MEMBERS = 10
"""A family with fewer has no spread of its own: one member that is off would pass for it."""
MARGIN = 4.0
"""Log units by which another factor must be likelier than the one stated."""
SUSPICIOUS = 2.0
"""Score of a family, in its standard deviations, from which its factors are tried."""


def learnt_scales(about: Scene, causes: Sequence[int] = ()) -> Mapping[str, float]:
    """Return the factors on healthy tolerances that the residuals call for.

    Parameters
    ----------
    about : Scene
    causes : sequence of int
        Causes that are there for certain; one more is allowed for.

    Returns
    -------
    mapping from family to float
        Empty where the stated tolerances do.
    """
    families = sorted({family for family in about.of.family if family})
    members = Counter(
        family for family, sd in zip(about.of.family, about.of.healthy, strict=True) if sd > 0.0
    )
    scales: dict[str, float] = {}
    here = metric(about.products, about.of.spread(scales, causes))
    best = _score(about, here, scales, causes)
    for factor in GRID:
        if factor != 1.0:
            tried = dict.fromkeys(families, factor)
            there = metric(about.products, about.of.spread(tried, causes))
            score = _score(about, there, tried, causes)
            if score > best + (MARGIN if not scales else 0.0):
                scales, here, best = tried, there, score
    for _ in range(2):
        for family in _suspects(about, here, scales, causes):
            if members[family] < MEMBERS:
                continue
            old = scales.get(family, 1.0)
            for factor in FAMILY_GRID:
                tried = {**scales, family: old * factor}
                if not 1.0 / LARGEST <= old * factor <= LARGEST:
                    continue
                sd = about.of.spread(scales, causes)
                there = respread(here, sd, about.of.spread(tried, causes))
                score = _score(about, there, tried, causes)
                if score > best + MARGIN:
                    scales, here, best = tried, there, score
    return {family: factor for family, factor in scales.items() if factor != 1.0}


def penalty(scales: Mapping[str, float]) -> float:
    """Return the log prior of factors: one draw for all, and one for each that differs."""
    values = Counter(scales.values())
    return -0.5 * sum(float(np.log(value) / OVERALL) ** 2 for value in values)


def _score(
    about: Scene, against: Metric, scales: Mapping[str, float], causes: Sequence[int]
) -> float:
    odds = all_log_odds(about.of, against)
    odds[list(causes)] = -np.inf
    best = float(odds.max(initial=-np.inf)) - float(np.log(max(len(odds), 1)))
    return against.log_likelihood + max(0.0, best) + penalty(scales)


def _suspects(
    about: Scene, against: Metric, scales: Mapping[str, float], causes: Sequence[int]
) -> list[str]:
    """Return families whose members are together larger or smaller than stated, worst first."""
    odds = all_log_odds(about.of, against)
    odds[list(causes)] = -np.inf
    if odds.max(initial=-np.inf) > 0.0:
        named = (*causes, int(np.argmax(odds)))
        sd = about.of.spread(scales, causes)
        against = respread(against, sd, about.of.spread(scales, named))
    sd = about.of.spread(scales)
    found: dict[str, float] = {}
    names = np.array(about.of.family)
    for family in {family for family in about.of.family if family}:
        at = np.flatnonzero((names == family) & (sd > 0.0))
        D = sd[at]
        K = D[:, None] * against.K[np.ix_(at, at)] * D
        score = float(np.sum((D * against.b[at]) ** 2) - np.trace(K))
        found[family] = abs(score) / (np.sqrt(2.0 * float(np.sum(K**2))) + 1e-12)
    return sorted((f for f in found if found[f] > SUSPICIOUS), key=lambda f: -found[f])
