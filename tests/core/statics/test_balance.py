# SPDX-License-Identifier: Apache-2.0
"""The moment balance: exact at rest, right derivatives, independent of frame and slope."""

import numpy as np
import pytest

from comcal.identify.groups import groups_of
from comcal.measure.plan import PlannedPose
from comcal.statics.balance import balance_at, first_moments, input_jacobian, residual
from comcal.statics.coefficients import balance_coefficients, total_wrench
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of


def moments_of(robot):
    return robot.tree.masses[:, None] * robot.tree.coms


@pytest.mark.parametrize("name", ["table1", "skewed", "table1_roll", "biped14"])
def test_nothing_is_left_of_the_balance_of_a_robot_at_rest(name, request):
    bench = request.getfixturevalue(name)
    for group in groups_of(bench.robot, bench.measure()):
        carried = bench.robot.tree.total_mass - group.below_mass
        balance = balance_at(bench.robot, group.carrier, group.q, group.w)
        left = residual(balance, carried, moments_of(bench.robot))
        assert np.abs(left).max() < 1e-9


@pytest.mark.parametrize("seed", [0, 1])
def test_nothing_is_left_of_the_balance_of_an_awkward_robot_on_any_slope(seed, odd):
    rng = np.random.default_rng(seed)
    robot = odd.odd_biped(rng)
    plan = awkward_plan(robot, rng)
    for group in groups_of(robot, odd.ideal_table(robot, plan, rng=rng)):
        carried = robot.tree.total_mass - group.below_mass
        balance = balance_at(robot, group.carrier, group.q, group.w)
        assert np.abs(residual(balance, carried, moments_of(robot))).max() < 1e-9
        # A gram too much weighs g newtons; S enters as S x up.
        heavier = residual(balance, carried + 1e-3, moments_of(robot))
        np.testing.assert_allclose(heavier[:, 0], -1e-3 * robot.gravity, atol=1e-9)


def awkward_plan(robot, rng):
    names = robot.tree.joint_names
    return [
        PlannedPose(
            i, rng.normal(0, 0.3, len(names)), support,
            floor_roll=float(rng.normal(0, 0.1)), floor_pitch=float(rng.normal(0, 0.1)),
        )
        for i, support in enumerate(["double", "left", "right"] * 3)
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["table1_roll", "biped14", 11, 12])
def test_input_jacobian_equals_finite_differences_away_from_equilibrium(name, odd, request):
    """Numbers: seeds of awkward robots with slides, mimics and leaning axes."""
    if isinstance(name, int):
        rng = np.random.default_rng(name)
        robot = odd.odd_biped(rng)
        table = odd.ideal_table(robot, awkward_plan(robot, rng), rng=rng)
    else:
        bench = request.getfixturevalue(name)
        robot, rng, table = bench.robot, np.random.default_rng(4), bench.measure()
    h = moments_of(robot) + rng.normal(0, 0.05, (len(robot.tree.links), 3))
    for group in groups_of(robot, table):
        q = group.q[:3] + rng.normal(0, 0.2, group.q[:3].shape)
        w = group.w[:3] + rng.normal(0, 5.0, group.w[:3].shape)

        def left(q, w, carrier=group.carrier):
            return residual(balance_at(robot, carrier, q, w), 17.0, h)

        B_w, B_q = input_jacobian(balance_at(robot, group.carrier, q, w), h)
        for j in range(q.shape[1]):
            step = np.zeros(q.shape[1])
            step[j] = 1e-6
            slope = (left(q + step, w) - left(q - step, w)) / 2e-6
            np.testing.assert_allclose(B_q[:, :, j], slope, atol=2e-6)
        for s in range(w.shape[1]):
            for a in range(6):
                step = np.zeros(w.shape[1:])
                step[s, a] = 1e-4
                slope = (left(q, w + step) - left(q, w - step)) / 2e-4
                np.testing.assert_allclose(B_w[:, :, s, a], slope, atol=1e-6)


def test_coefficients_put_the_carried_com_on_the_line(biped14):
    table = biped14.measure()
    robot = biped14.robot
    found = balance_coefficients(robot, table)
    for group in groups_of(robot, table):
        balance = balance_at(robot, group.carrier, group.q, group.w)
        com = first_moments(balance, moments_of(robot)).sum(axis=1) / (
            robot.tree.total_mass - group.below_mass
        )
        from comcal.statics.stance import stance_frame

        R, p = stance_frame(robot, group.carrier.support, balance.placements)
        in_P = np.einsum("nji,nj->ni", R, com - p)
        alpha, beta, gamma, delta = found.values[[found.rows.index(r) for r in group.rows]].T
        np.testing.assert_allclose(in_P[:, 0], alpha + beta * in_P[:, 2], atol=1e-12)
        np.testing.assert_allclose(in_P[:, 1], gamma + delta * in_P[:, 2], atol=1e-12)


@pytest.mark.parametrize(("roll", "pitch"), [(0.05, 0.0), (0.0, -0.08), (0.06, 0.1)])
def test_a_slope_shows_as_beta_and_delta(table1, roll, pitch):
    pose = PlannedPose(1, table1.pose(), floor_roll=roll, floor_pitch=pitch)
    found = balance_coefficients(table1.robot, table1.measure([pose]))
    _, beta, _, delta = found.values[0]
    assert beta == pytest.approx(-np.tan(pitch) / np.cos(roll), abs=1e-12)
    assert delta == pytest.approx(np.tan(roll), abs=1e-12)
    assert found.mass[0] == pytest.approx(18.4, abs=1e-9)


def test_coefficients_do_not_change_when_every_wrench_is_scaled(table1):
    table = table1.measure()
    robot = table1.robot
    carrier = carrier_of(robot, "double")
    w = np.stack([table.wrench[s] for s in carrier.sensors], axis=1)
    at = placed_in_stance(robot, carrier, table.q)
    once = total_wrench(carrier, at, w)
    twice = total_wrench(carrier, at, 2.5 * w)
    np.testing.assert_allclose(twice, 2.5 * once, rtol=1e-12, atol=1e-12)


def test_coefficient_sigmas_are_those_of_repeated_measurements(biped14):
    rng = np.random.default_rng(8)
    plan = [biped14.plan[i] for i in (3, 20, 30)]
    table = biped14.measure(plan)
    draws = [
        balance_coefficients(biped14.robot, biped14.noisy(table, rng)).values for _ in range(200)
    ]
    found = balance_coefficients(biped14.robot, table)
    ratio = np.std(draws, axis=0) / found.sigma
    # 200 draws: the standard deviation itself is uncertain by 5 %.
    assert np.abs(ratio - 1.0).max() < 0.2
