# SPDX-License-Identifier: Apache-2.0
r"""How much better any other choice from the same candidates could be.

A design that may visit candidates for any fraction :math:`w_i` of the poses is a convex problem; no
N poses beat it. The multiplicative algorithm comes near its solution, and whatever weights it stops
at certify a bound: with :math:`M = \sum w_i F_i^T F_i`,

- D-optimal: :math:`\log\det M^* \le \log\det M + r\,(\max_i d_i / r - 1)` with
  :math:`d_i = \mathrm{tr}(F_i M^{-1} F_i^T)` and r the rank (Kiefer and Wolfowitz);
- traces: :math:`\varphi^* \ge \varphi^2 / \max_i g_i` with :math:`\varphi = \mathrm{tr}(C M^{-1})`
  and :math:`g_i = \mathrm{tr}(F_i M^{-1} C M^{-1} F_i^T)`, since :math:`\varphi` is convex and
  homogeneous of degree -1.
"""

from __future__ import annotations

import numpy as np

from comcal.plan.design import Goal, Problem, flat_product
from comcal.robot.tree import Array

STEPS = 150
"""Of the multiplicative algorithm; a few hundred candidates are left with weight after that."""
CLOSE = 0.02
"""Relative gap at which it stops."""


def best_possible(problem: Problem, n: int) -> float:
    """Return a loss that no choice of *n* candidates beats.

    Parameters
    ----------
    problem : Problem
        With the goal ``dopt`` or ``com_z``; without information that is there anyway.
    n : int

    Returns
    -------
    float
        As of :meth:`~comcal.plan.design.Problem.loss`; -inf for the goal ``worst``.
    """
    if problem.goal is Goal.WORST or not len(problem.roots):
        return -np.inf
    F, rank = problem.roots, problem.fixed.shape[0]
    is_d = problem.goal is Goal.DOPT
    weight = np.full(len(F), 1.0 / len(F))
    bound = -np.inf
    for _ in range(STEPS):
        weighted = (F * weight[:, None, None]).reshape(-1, rank)
        M = F.reshape(-1, rank).T @ weighted
        V = np.linalg.inv(M + problem.ridge / n)
        FV = flat_product(F, V)
        if is_d:
            gain = np.einsum("nij,nij->n", FV, F)
            found = -float(np.linalg.slogdet(M)[1]) - (float(gain.max()) - rank)
            mean, power = rank, 1.0
        else:
            gain = np.einsum("nij,nij->n", flat_product(FV, problem.wanted), FV)
            mean, power = float(np.sum(problem.wanted * V)), 0.5
            found = float(np.log(mean**2 / gain.max()))
        bound = max(bound, found)
        if gain.max() < mean * (1.0 + CLOSE):
            break
        weight = weight * (gain / mean) ** power
        weight /= weight.sum()
    # N poses carry N times the information of a design whose weights add up to one.
    return bound - (rank * np.log(n) if is_d else np.log(n))


def efficiency(problem: Problem, chosen: list[int]) -> float:
    """Return at least which share of the best possible information per pose a choice has.

    Parameters
    ----------
    problem : Problem
    chosen : list of int

    Returns
    -------
    float
        0 to 1; for ``dopt`` the mean over directions, for ``com_z`` the ratio of variances. NaN
        for the goal ``worst`` and where poses are there already.
    """
    if problem.goal is Goal.WORST or problem.fixed.any():
        return float("nan")
    loss, best = problem.loss(problem.information(chosen)), best_possible(problem, len(chosen))
    rank = problem.fixed.shape[0] if problem.goal is Goal.DOPT else 1
    return float(np.exp((best - loss) / rank))


def worst_sigma(information: Array) -> float:
    """Return the standard deviation of the worst combination of unit length, scaled unknowns.

    Parameters
    ----------
    information : array, shape (rank, rank)
    """
    return float(1.0 / np.sqrt(np.linalg.eigvalsh(information)[0]))
