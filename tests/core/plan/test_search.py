# SPDX-License-Identifier: Apache-2.0
"""What a plan promises is what a calibration gets, and more than random poses give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from comcal.identify.adjust import adjust
from comcal.identify.groups import groups_of
from comcal.measure.plan import PlannedPose
from comcal.plan.bound import worst_sigma
from comcal.plan.candidates import Pool
from comcal.plan.com_height import height_gradients, height_sigma
from comcal.plan.design import Goal
from comcal.plan.expected import expected_table
from comcal.plan.forecast import forecast
from comcal.plan.information import information_roots, predicted_fit


def planned(pool: Pool) -> list[PlannedPose]:
    return [
        PlannedPose(i, q, s) for i, (s, q) in enumerate(zip(pool.support, pool.q, strict=True), 1)
    ]


def information(planning: Any, pool: Pool) -> np.ndarray:
    rows = (information_roots(planning.unknowns, pool) @ planning.found.basis).reshape(
        -1, planning.found.basis.shape[1]
    )
    return rows.T @ rows


def random_sets(planning: Any, count: int) -> list[Pool]:
    rng = np.random.default_rng(8)
    n = len(planning.found.poses)
    return [
        planning.random.select(rng.choice(len(planning.random), n, replace=False))
        for _ in range(count)
    ]


def test_expected_readings_are_those_of_the_world(planning: Any, biped14: Any) -> None:
    pool = planning.found.poses
    table, measured = expected_table(planning.robot, pool), biped14.measure(planned(pool))
    fits = [
        adjust(planning.robot, planning.unknowns, groups_of(planning.robot, t))
        for t in (table, measured)
    ]
    np.testing.assert_allclose(fits[1].theta, planning.unknowns.cad, atol=1e-6)
    for i, support in enumerate(pool.support):
        if support != "double":  # the split between two feet is anybody's guess
            seen, true = (
                table.wrench[f"{support[0]}_foot"][i],
                measured.wrench[f"{support[0]}_foot"],
            )
            np.testing.assert_allclose(seen, true[i], atol=1e-6)


def test_information_is_that_of_the_fit(planning: Any) -> None:
    pool = planning.found.poses
    fit = predicted_fit(planning.unknowns, expected_table(planning.robot, pool))
    basis = planning.found.basis
    assert fit.rank == basis.shape[1]
    scale = planning.unknowns.scale
    cov = basis.T @ (fit.cov / np.outer(scale, scale)) @ basis
    np.testing.assert_allclose(
        np.diag(cov), np.diag(np.linalg.inv(information(planning, pool))), rtol=1e-4
    )


def test_planned_poses_calibrate_better_than_random_ones(planning: Any, biped14: Any) -> None:
    """In the built-in world, with realistic noise; the truth is the URDF."""
    unknowns, basis = planning.unknowns, planning.found.basis

    def errors(pool: Pool, draws: int) -> float:
        exact = biped14.measure(planned(pool))
        rng, squares = np.random.default_rng(9), []
        for _ in range(draws):
            fit = adjust(
                planning.robot, unknowns, groups_of(planning.robot, biped14.noisy(exact, rng))
            )
            off = basis.T @ ((fit.theta - unknowns.cad) / unknowns.scale)
            squares.append(np.sum(off**2))
        return float(np.sqrt(np.mean(squares)))

    ours = errors(planning.found.poses, 8)
    others = [errors(pool, 4) for pool in random_sets(planning, 5)]
    assert ours < 0.67 * np.median(others)


@pytest.mark.parametrize("goal", [Goal.COM_Z, Goal.WORST])
def test_a_goal_is_served_better_than_by_random_poses(planning: Any, goal: Goal) -> None:
    found = planning.search(20, 3, goal=goal)
    heights = height_gradients(planning.unknowns, planning.random)

    def judge(pool: Pool) -> float:
        M = information(planning, pool)
        if goal is Goal.WORST:
            return worst_sigma(M)
        return height_sigma(heights, M, planning.found.basis)

    assert judge(found.poses) < 0.7 * np.median([judge(p) for p in random_sets(planning, 9)])


def test_same_seed_gives_the_same_plan(planning: Any) -> None:
    again = planning.search(20, 1)
    np.testing.assert_array_equal(again.poses.q, planning.found.poses.q)
    assert again.poses.support == planning.found.poses.support


def test_improving_never_lowers_what_is_known(planning: Any) -> None:
    recorded = expected_table(planning.robot, planning.random.select(range(0, 180, 9)))
    found = planning.search(6, 4, recorded=recorded)
    added = expected_table(planning.robot, found.poses)
    before = forecast(planning.unknowns, planning.random, recorded)
    after = forecast(planning.unknowns, planning.random, recorded, added)
    assert after.rank >= before.rank
    assert np.all(after.total_com <= before.total_com)
    old, new = (
        predicted_fit(planning.unknowns, *tables) for tables in ((recorded,), (recorded, added))
    )
    seen = planning.found.basis
    scale = np.outer(planning.unknowns.scale, planning.unknowns.scale)
    change = seen.T @ (old.cov / scale - new.cov / scale) @ seen
    assert np.linalg.eigvalsh(change)[0] > -1e-9 * np.abs(change).max()


def test_order_has_short_moves(planning: Any) -> None:
    poses = planning.found.poses
    moves = np.abs(np.diff(poses.q, axis=0)) / planning.rules.box.range
    shuffled = poses.q[np.random.default_rng(5).permutation(len(poses))]
    others = np.abs(np.diff(shuffled, axis=0)) / planning.rules.box.range
    assert moves.max(axis=1).sum() < 0.9 * others.max(axis=1).sum()
    changes = sum(a != b for a, b in zip(poses.support, poses.support[1:], strict=False))
    assert changes == len(set(poses.support)) - 1
