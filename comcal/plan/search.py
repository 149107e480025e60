# SPDX-License-Identifier: Apache-2.0
"""The search for a plan: candidates, a choice, better candidates around it, a better choice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.unknowns import Unknowns
from comcal.measure.table import PoseTable
from comcal.plan.bound import efficiency
from comcal.plan.candidates import Pool, Progress, neighbours, random_pool, silent
from comcal.plan.com_height import height_gradients
from comcal.plan.design import Goal, Problem, choose
from comcal.plan.expected import expected_table
from comcal.plan.information import information_roots, predicted_fit, table_roots
from comcal.plan.order import ordered
from comcal.plan.rules import Rules
from comcal.robot.tree import Array

KEPT = 3000
"""Candidates kept from round to round: those chosen, and the newest."""
REFERENCE = 300
"""Poses of the pool that decide which directions are determined at all."""


@dataclass(frozen=True)
class Effort:
    """How much a search looks at.

    Parameters
    ----------
    seeds : int
        Random poses of every support.
    grown, growth : int, float
        Tries around each of them, and how far a joint typically moves for it, as a share of its
        range.
    around : int
        Tries around each chosen pose in every round of refinement ...
    rounds : tuple of float
        ... and how far they go.
    """

    seeds: int = 60
    grown: int = 10
    growth: float = 0.25
    around: int = 12
    rounds: tuple[float, ...] = (0.3, 0.2, 0.1, 0.05)


THOROUGH = Effort()


@dataclass(frozen=True)
class Found:
    """A plan and what was known when it was chosen.

    Parameters
    ----------
    poses : Pool
        The plan, in the order in which to take the poses.
    held_out : Pool
        Random poses in which the total CoM is to be predicted.
    candidates : int
        Poses that were looked at.
    basis : array, shape (size, rank)
        Directions of the scaled unknowns that candidates and recorded poses determine.
    efficiency : float
        Lower bound of the choice's efficiency among its candidates; NaN where none is known.
    """

    poses: Pool
    held_out: Pool
    candidates: int
    basis: Array
    efficiency: float


def search(
    rules: Rules,
    unknowns: Unknowns,
    n: int,
    rng: np.random.Generator,
    *,
    goal: Goal = Goal.DOPT,
    recorded: PoseTable | None = None,
    effort: Effort = THOROUGH,
    progress: Progress = silent,
) -> Found:
    """Search *n* poses.

    Parameters
    ----------
    rules : Rules
        What every pose keeps.
    unknowns : Unknowns
        What is to be identified.
    n : int
    rng : Generator
    goal : Goal
    recorded : PoseTable, optional
        Poses that are there already: the plan adds to them.
    effort : Effort
    progress : callable

    Raises
    ------
    NotBalancedError
        If no pose stands in some support.
    """
    seeds = random_pool(rules, effort.seeds, rng, progress)
    pool = seeds.joined(neighbours(rules, seeds, effort.grown, effort.growth, rng))
    basis = determined(unknowns, pool, recorded)
    fixed = np.zeros((basis.shape[1],) * 2)
    if recorded is not None:
        fixed = _information(table_roots(unknowns, recorded) @ basis)
    heights = height_gradients(unknowns, seeds) @ basis
    wanted = heights.T @ heights / len(heights)
    roots = information_roots(unknowns, pool) @ basis
    looked_at, chosen = len(pool), list[int]()
    for k, reach in enumerate((*effort.rounds, 0.0)):
        problem = Problem(roots, fixed, goal, wanted)
        chosen = choose(problem, n, chosen)
        progress("choosing", k + 1, len(effort.rounds) + 1)
        if reach:
            near = neighbours(rules, pool.select(chosen), effort.around, reach, rng)
            looked_at += len(near)
            near_roots = information_roots(unknowns, near) @ basis
            # One copy of each chosen pose leads; the oldest others go first.
            keep = [*dict.fromkeys(chosen)]
            others = sorted(set(range(len(pool))) - set(keep))
            room = max(KEPT - len(keep) - len(near), 0)
            rows = keep + others[len(others) - min(room, len(others)) :]
            chosen = [keep.index(i) for i in chosen]
            pool = pool.select(rows).joined(near)
            roots = np.concatenate([roots[rows], _as_high(near_roots, roots.shape[1])])
    bound = efficiency(Problem(roots, fixed, goal, wanted), chosen)
    rest = np.clip(np.zeros(len(rules.box.lower)), rules.box.lower, rules.box.upper)
    return Found(
        ordered(pool.select(chosen), rest, rules.box.range), seeds, looked_at, basis, bound
    )


def determined(unknowns: Unknowns, pool: Pool, recorded: PoseTable | None = None) -> Array:
    """Return the directions that a pool determines, by the identification's own rule.

    Parameters
    ----------
    unknowns : Unknowns
    pool : Pool
    recorded : PoseTable, optional

    Returns
    -------
    basis : array, shape (size, rank)
        Orthonormal, in scaled unknowns.
    """
    some = np.unique(np.linspace(0, len(pool) - 1, REFERENCE).astype(int))
    tables = [expected_table(unknowns.robot, pool.select(some))]
    return predicted_fit(unknowns, *tables, *([recorded] if recorded is not None else [])).seen


def _information(roots: Array) -> Array:
    return np.einsum("nij,nik->jk", roots, roots)


def _as_high(roots: Array, n_rows: int) -> Array:
    return np.pad(roots, ((0, 0), (0, n_rows - roots.shape[1]), (0, 0)))
