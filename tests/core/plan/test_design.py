# SPDX-License-Identifier: Apache-2.0
"""The choice against brute force, the bound against every choice, on small problems."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest

from comcal.plan.bound import best_possible, efficiency
from comcal.plan.design import Goal, Problem, choose

RANK, POSES, CANDIDATES = 4, 4, 9


def problem(goal: Goal, seed: int) -> Problem:
    rng = np.random.default_rng(seed)
    wanted = rng.standard_normal((3, RANK))
    return Problem(
        rng.standard_normal((CANDIDATES, 2, RANK)),
        np.zeros((RANK, RANK)),
        goal,
        wanted.T @ wanted,
    )


def best_loss(given: Problem) -> float:
    every = combinations_with_replacement(range(CANDIDATES), POSES)
    return min(given.loss(given.information(list(c))) for c in every)


@pytest.mark.parametrize("goal", list(Goal))
@pytest.mark.parametrize("seed", range(4))
def test_best_addition_is_the_best(goal: Goal, seed: int) -> None:
    given = problem(goal, seed)
    M = given.information([0, 1, 2])
    losses = [given.loss(given.information([0, 1, 2, k])) for k in range(CANDIDATES)]
    best, loss = given.best_addition(M)
    assert loss == pytest.approx(losses[best], rel=1e-9)
    if goal is not Goal.WORST:  # there, only the most promising are asked
        assert best == int(np.argmin(losses))


@pytest.mark.parametrize("goal", [Goal.DOPT, Goal.COM_Z])
def test_choice_is_nearly_as_good_as_brute_force(goal: Goal) -> None:
    behind = []
    for seed in range(6):
        given = problem(goal, seed)
        chosen = choose(given, POSES)
        behind.append(given.loss(given.information(chosen)) - best_loss(given))
    assert min(behind) > -1e-9
    assert np.median(behind) < 0.02


@pytest.mark.parametrize("goal", [Goal.DOPT, Goal.COM_Z])
@pytest.mark.parametrize("seed", range(4))
def test_no_choice_beats_the_bound(goal: Goal, seed: int) -> None:
    given = problem(goal, seed)
    assert best_possible(given, POSES) <= best_loss(given) + 1e-6
    assert 0.3 < efficiency(given, choose(given, POSES)) <= 1.0


def test_bound_is_reached_where_the_best_is_known() -> None:
    """One candidate per axis: equal visits are D-optimal."""
    given = Problem(np.eye(RANK)[:, None], np.zeros((RANK, RANK)), Goal.DOPT, np.eye(RANK))
    chosen = choose(given, 2 * RANK)
    assert sorted(chosen) == sorted([*range(RANK), *range(RANK)])
    assert efficiency(given, chosen) == pytest.approx(1.0, abs=1e-5)


def test_what_is_there_already_is_not_chosen_again() -> None:
    fixed = np.diag([1e3, 1e3, 0.0, 0.0])
    given = Problem(np.eye(RANK)[:, None], fixed, Goal.DOPT, np.eye(RANK))
    assert set(choose(given, 2)) == {2, 3}
