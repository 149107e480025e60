# SPDX-License-Identifier: Apache-2.0
r"""Choosing N poses of a pool: Fedorov's exchange, for three goals.

With M the information of the chosen poses (and of those measured already), restricted to what the
pool determines, the goals are

- ``dopt``: the largest :math:`\det M`, i.e. the smallest confidence ellipsoid;
- ``com_z``: the smallest mean variance :math:`\mathrm{tr}(C M^{-1})` of total CoM heights;
- ``worst``: the largest smallest eigenvalue of M, i.e. the best worst combination.

Exchanging one pose changes M by a few rows, so determinants and traces of all candidates follow
from small matrices. Without a remedy M may be singular while few poses are chosen: it starts from a
ridge far below any information that counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from comcal.robot.tree import Array

RIDGE = 1e-7
"""Of the pool's mean information, on every direction."""
PASSES = 12
"""Rounds over all chosen poses at most; each goes on only while something improves."""
LEAST_GAIN = 1e-6
"""Relative improvement (of the logarithm) that counts."""
ASKED = 6
"""Candidates whose smallest eigenvalue is computed for the goal ``worst``."""
SHARPNESS = 3
"""For screening, the worst eigenvalue stands out by this power."""


class Goal(Enum):
    """What the chosen poses are to be best for."""

    DOPT = "dopt"
    COM_Z = "com_z"
    WORST = "worst"


@dataclass(frozen=True)
class Problem:
    """Rows of all candidates in the directions that they determine.

    Parameters
    ----------
    roots : array, shape (N, n_rows, rank)
    fixed : array, shape (rank, rank)
        Information that is there anyway.
    goal : Goal
    wanted : array, shape (rank, rank)
        C of the goal ``com_z``; unused otherwise.
    """

    roots: Array
    fixed: Array
    goal: Goal
    wanted: Array

    @property
    def ridge(self) -> Array:
        """Information that keeps M regular, shape (rank, rank)."""
        rank = self.fixed.shape[0]
        mean = float(np.sum(self.roots**2)) / max(rank * len(self.roots), 1)
        return RIDGE * mean * np.eye(rank)

    def information(self, chosen: list[int]) -> Array:
        """Return M of some candidates and of what is there anyway, ridge included."""
        F = self.roots[chosen].reshape(-1, self.fixed.shape[0])
        return self.fixed + self.ridge + F.T @ F

    def loss(self, M: Array) -> float:
        """Return what is to be small; a logarithm, so that differences are relative gains."""
        if self.goal is Goal.DOPT:
            return -float(np.linalg.slogdet(M)[1])
        if self.goal is Goal.COM_Z:
            return float(np.log(np.sum(self.wanted * np.linalg.inv(M))))
        return -float(np.log(np.linalg.eigvalsh(M)[0]))

    def best_addition(self, M: Array) -> tuple[int, float]:
        """Return the candidate whose addition to M is best, and the loss then."""
        V = np.asarray(np.linalg.inv(M), np.float64)
        FV = flat_product(self.roots, V)
        I_G = np.eye(self.roots.shape[1]) + FV @ np.swapaxes(self.roots, 1, 2)
        if self.goal is Goal.DOPT:
            gain = np.linalg.slogdet(I_G)[1]
            best = int(np.argmax(gain))
            return best, self.loss(M) - float(gain[best])
        C = self.wanted if self.goal is Goal.COM_Z else _stressed(V)
        H = flat_product(FV, C) @ np.swapaxes(FV, 1, 2)
        saved = np.einsum("nii->n", np.linalg.solve(I_G, H))
        if self.goal is Goal.COM_Z:
            best = int(np.argmax(saved))
            return best, float(np.log(np.sum(C * V) - saved[best]))
        asked = np.argsort(-saved)[:ASKED]
        tried = M + np.swapaxes(self.roots[asked], 1, 2) @ self.roots[asked]
        least = np.linalg.eigvalsh(tried)[:, 0]
        best = int(np.argmax(least))
        return int(asked[best]), -float(np.log(least[best]))


def flat_product(rows: Array, V: Array) -> Array:
    """Return ``rows @ V`` for rows (N, k, r), as the one large product that is fastest.

    Parameters
    ----------
    rows : array, shape (N, k, r)
    V : array, shape (r, m)
    """
    return (rows.reshape(-1, V.shape[0]) @ V).reshape(*rows.shape[:2], V.shape[1])


def _stressed(V: Array) -> Array:
    """Return weights that make a trace of V speak for its largest eigenvalues."""
    value, vector = np.linalg.eigh(V)
    weight = (value / value[-1]) ** SHARPNESS
    return (vector * weight) @ vector.T


def choose(
    problem: Problem,
    n: int,
    start: list[int] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[int]:
    """Choose *n* candidates; one may be chosen several times where repeating it is best.

    Parameters
    ----------
    problem : Problem
    n : int
    start : list of int, optional
        To go on from; missing ones are added greedily.
    progress : callable, optional
        Called with how many exchanges of a round are done, and how many there are.
    """
    chosen = list(start or [])[:n]
    M = problem.information(chosen)
    while len(chosen) < n:
        best, _ = problem.best_addition(M)
        chosen.append(best)
        M = problem.information(chosen)
    loss = problem.loss(M)
    for _ in range(PASSES):
        before = loss
        for k in range(n):
            rest = problem.information(chosen[:k] + chosen[k + 1 :])
            best, with_best = problem.best_addition(rest)
            if with_best < loss - LEAST_GAIN:
                chosen[k], loss = best, with_best
            if progress is not None:
                progress(k + 1, n)
        if before - loss < n * LEAST_GAIN:
            break
    return chosen
