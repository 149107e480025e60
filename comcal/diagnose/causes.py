# SPDX-License-Identifier: Apache-2.0
"""Named causes in the words and units of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtri

from comcal.diagnose.candidates import Candidate
from comcal.diagnose.catalogue import Catalogue
from comcal.diagnose.diagnosis import Cause, Estimate, Gain, Rival
from comcal.diagnose.mistakes import Mistake
from comcal.diagnose.naming import Named
from comcal.diagnose.rivals import own_coordinates, rivals_of, size_of, undecided
from comcal.effects.registry import effects
from comcal.robot.changes import spec_of
from comcal.robot.tree import Array

Z = float(ndtri(0.975))
"""Half width of a 95 % interval in standard deviations."""


def cause_of(named: Named, i: int, gain: Gain | None, searched: Named) -> Cause:
    """Return cause *i* of what was named, with its rivals.

    Parameters
    ----------
    named : Named
        About its causes: with parameters as they are stated.
    i : int
    gain : Gain or None
    searched : Named
        As it was searched. What would stand in the place of a cause is not to be linearised about
        it: a mass at the CoM of a link sits elsewhere once a payload has moved that CoM.
    """
    candidate = named.scene.of.candidates[i]
    x = own_coordinates(named, i)
    cov = _own_cov(named, i)
    rivals, log_odds = rivals_of(searched, i)
    return Cause(
        candidate.change(x),
        estimates_of(candidate, x, cov),
        log_odds,
        size_of(named, i),
        rivals,
        gain,
        candidate.effect.signature,
        candidate.effect.remedy,
        candidate.effect.separated_by,
        _outside(named.scene.of, i, x, cov),
    )


def outright(mistake: Mistake) -> Cause:
    """Return a mistake that was undone as a cause."""
    effect = effects()[mistake.change.effect]
    return Cause(
        mistake.change,
        {},
        mistake.log_odds,
        float(np.sqrt(2.0 * max(mistake.log_odds, 0.0))),
        tuple(Rival(c.effect, c.target, odds, 0.0) for c, odds in mistake.rivals),
        None,
        effect.signature,
        effect.remedy,
        effect.separated_by,
    )


def estimates_of(candidate: Candidate, x: Array, cov: Array) -> Mapping[str, Estimate]:
    """Return parameters with intervals; places of a mass and stiffnesses to first order.

    Parameters
    ----------
    candidate : Candidate
    x : array, shape (k,)
    cov : array, shape (k, k)
    """
    effect = candidate.effect
    keys = spec_of(effect.name).keys
    change = candidate.change(x)
    found: dict[str, Estimate] = {}
    for key, value in change.parameters.items():
        if isinstance(value, tuple):
            continue
        slope = _slope(candidate, key, x)
        sigma = float(np.sqrt(max(slope @ cov @ slope, 0.0)))
        interval = (value - Z * sigma, value + Z * sigma)
        if key == effect.inverse:
            k = candidate.keys.index(key)
            ends = x[k] + Z * np.sqrt(cov[k, k]) * np.array([1.0, -1.0])
            interval = (1.0 / ends[0], 1.0 / ends[1] if ends[1] > 0.0 else float("inf"))
        found[key] = Estimate(value, sigma, interval, keys[key].unit if key in keys else "")
    return found


def _slope(candidate: Candidate, key: str, x: Array) -> Array:
    """Return d parameter / d coordinates, shape (k,): places and stiffnesses are not linear."""
    steps = 1e-6 * candidate.fault
    ahead, behind = (
        [candidate.change(x + sign * step).number(key) for step in np.diag(steps)]
        for sign in (1.0, -1.0)
    )
    return (np.array(ahead) - np.array(behind)) / (2.0 * steps)


def groups_of(causes: Sequence[Cause]) -> tuple[tuple[Rival, ...], ...]:
    """Return for every cause that has rivals which cannot be excluded the set of all of them."""
    found: list[tuple[Rival, ...]] = []
    for cause in causes:
        rivals = undecided(cause.change, cause.rivals)
        if rivals:
            change = cause.change
            own = Rival(change.effect, change.target, 0.0, 0.0, poses=change.poses() or ())
            found.append((own, *rivals))
    return tuple(found)


def _own_cov(named: Named, i: int) -> Array:
    first = 0
    for cause in named.causes:
        k = len(named.scene.of.candidates[cause].keys)
        if cause == i:
            return named.fit.cov[first : first + k, first : first + k]
        first += k
    raise KeyError(i)


def _outside(of: Catalogue, i: int, x: Array, cov: Array) -> tuple[str, ...]:
    """Return the keys whose interval does not reach three healthy standard deviations."""
    part = of.slices[i]
    healthy = 3.0 * of.healthy[part]
    clear = np.abs(x) - Z * np.sqrt(np.diag(cov)) > healthy
    return tuple(
        key
        for key, is_outside, sd in zip(of.candidates[i].keys, clear, healthy, strict=True)
        if is_outside and sd > 0.0
    )
