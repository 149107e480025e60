# SPDX-License-Identifier: Apache-2.0
"""Parameters of the causes named, by the residuals themselves instead of their linearisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from comcal.diagnose.catalogue import Catalogue
from comcal.diagnose.evidence import Explanation, whole
from comcal.diagnose.linear import Linear
from comcal.diagnose.scene import Scene
from comcal.diagnose.whitening import whitening
from comcal.effects.effect import State
from comcal.effects.registry import in_stages
from comcal.predict.parity import parity
from comcal.robot.changes import Change
from comcal.robot.tree import Array

ROUNDS = 4
"""Steps of the refit: each is far smaller than the one before."""
LARGE = 1000.0
"""Norm of causes, in sigmas of noise, from which everything else is linearised about them anew
while they are looked for."""
LARGE_BESIDE = 20.0
"""The same at the end: a healthy spread of a few percent of a cause is soon more than the noise
that its interval is made of."""
FAR = 2.0
"""Way of a coordinate from which its columns are found anew, in standard deviations."""
SMALL_STEP = 0.05
"""A step that matters no longer, in standard deviations of the parameters."""
STEP = 1e-4
"""Of the derivatives, as a share of a fault."""


def changes_at(of: Catalogue, causes: Sequence[int], coordinates: Array) -> tuple[Change, ...]:
    """Return causes as changes; their coordinates stand one after the other."""
    found: list[Change] = []
    first = 0
    for i in causes:
        k = len(of.candidates[i].keys)
        found.append(of.candidates[i].change(coordinates[first : first + k]))
        first += k
    return tuple(found)


def corrected_by(of: Catalogue, causes: Sequence[int], coordinates: Array, state: State) -> State:
    """Apply causes to a state."""
    of_causes = [of.candidates[i].effect for i in causes]
    return in_stages(state, zip(of_causes, changes_at(of, causes, coordinates), strict=True))


def refitted(
    about: Scene, causes: tuple[int, ...], large: float = LARGE
) -> tuple[Scene, Explanation]:
    """Fit causes without linearising them, and return the scene about them.

    Parameters
    ----------
    about : Scene
    causes : tuple of int
    large : float
        Norm of causes, in sigmas of noise, from which everything else is linearised about them.

    Returns
    -------
    scene : Scene
        With the columns of the causes where they are, and the residuals that the causes together
        with these columns stand for.
    explanation : Explanation
        Of all causes at once.
    """
    if not causes:
        return about, Explanation(0.0, np.zeros(0), np.zeros((0, 0)))
    of, state = about.of, about.origin
    at = np.concatenate([np.arange(of.slices[i].start, of.slices[i].stop) for i in causes])
    found = whole(of, causes, about.products, about.scales)
    for turn in range(ROUNDS):
        x = found.coordinates
        there = corrected_by(of, causes, x, state)
        if turn == 0 and _way(about, at, x) > large:
            about = _linear_about(about, there, at, x)
        values = parity(*there).values
        raw, fitted = about.raw.copy(), about.fitted.copy()
        for k in _stale(about, causes, found):
            j = at[k]
            fitted[j] = x[k]
            step = np.zeros(len(x))
            # One-sided, away from zero: a spring or a play has no other side.
            step[k] = STEP * of.fault[j] * (1.0 if x[k] >= 0.0 else -1.0)
            ahead = parity(*corrected_by(of, causes, x + step, state)).values
            raw[:, j] = np.nan_to_num(values - ahead) / step[k]
        by = about.by.restricted(np.isfinite(values))
        if by is about.by:
            X = about.X.copy()
            X[:, at] = by.turned(raw[:, at])
        else:  # a cause makes readings meaningless where nobody knows which way it acts
            X = by.turned(raw)
        r = by.turned(np.nan_to_num(values)) + X[:, at] @ x
        about = replace(about, fitted=fitted, raw=raw, by=by, X=X, r=r)
        found = whole(of, causes, about.products, about.scales)
        moved = found.coordinates - x
        if np.all(np.abs(moved) <= SMALL_STEP * np.sqrt(np.diag(found.cov)) + 1e-15):
            break
    return about, found


def _stale(about: Scene, causes: Sequence[int], found: Explanation) -> list[int]:
    """Return the coordinates of the fit whose columns belong to other values of their cause."""
    stale: list[int] = []
    first = 0
    sigma = np.sqrt(np.diag(found.cov))
    for i in causes:
        part = about.of.slices[i]
        mine = range(first, first + part.stop - part.start)
        first = mine.stop
        moved = np.abs(found.coordinates[mine.start : mine.stop] - about.fitted[part])
        if not np.all(moved <= FAR * sigma[mine.start : mine.stop] + 1e-15):
            stale += mine
    return stale


def _way(about: Scene, at: npt.NDArray[np.intp], x: Array) -> float:
    """Return how far causes are from those that the scene is linear about, in sigmas of noise."""
    way = -about.centre
    way[at] += x
    return float(np.linalg.norm(about.X @ way))


def _linear_about(about: Scene, state: State, at: npt.NDArray[np.intp], x: Array) -> Scene:
    """Return the scene with the columns and the whitening of another state."""
    linear = Linear(*state)
    by = whitening(linear)
    raw = about.of.columns(linear)
    centre = np.zeros(len(about.centre))
    centre[at] = x
    fitted = np.full(len(centre), np.nan)
    return replace(about, at=linear, centre=centre, fitted=fitted, raw=raw, by=by, X=by.turned(raw))
