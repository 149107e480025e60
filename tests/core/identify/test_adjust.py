# SPDX-License-Identifier: Apache-2.0
"""The all-data fit: exact without noise, honest with it, and unmoved by arbitrary choices."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_distribution

from comcal.errors import RankError
from comcal.identify.adjust import adjust
from comcal.identify.groups import groups_of
from comcal.identify.unknowns import unknowns_of
from comcal.identify.words import combinations_of, unseen_directions
from comcal.measure.plan import PlannedPose
from comcal.robot.model import Robot
from comcal.robot.tree import Tree


def perturbed(robot: Robot, rng: np.random.Generator, spread: float) -> Robot:
    """A true robot whose links above the cuts have other CoMs than the URDF says."""
    free = unknowns_of(robot).links
    links = tuple(
        replace(link, com=link.com + rng.normal(0, spread, 3)) if k in free else link
        for k, link in enumerate(robot.tree.links)
    )
    tree = Tree(robot.tree.name, links, robot.tree.joints)
    return replace(robot, tree=tree)


def fit(robot, table):
    return adjust(robot, unknowns_of(robot), groups_of(robot, table))


@pytest.mark.parametrize("name", ["table1", "biped14"])
def test_a_robot_far_from_its_urdf_comes_back_exactly_where_it_is_seen(name, request):
    bench = request.getfixturevalue(name)
    true = perturbed(bench.robot, np.random.default_rng(3), 0.02 if name == "biped14" else 0.005)
    found = fit(bench.robot, bench.measure(true_robot=true))
    wanted = replace(found.unknowns, robot=true).cad
    error = (found.theta - wanted) / found.unknowns.scale
    assert np.abs(found.seen.T @ error).max() < 1e-7
    assert found.chi2 < 1e-6
    assert max(np.abs(r).max() for r in found.residuals) < 1e-6
    single = found.visibility(np.eye(found.unknowns.size)) < 1e-6
    assert single.sum() >= (7 if name == "table1" else 20)
    assert np.abs(error[single]).max() < 1e-7


@pytest.mark.parametrize(("name", "rank"), [("table1", 12), ("biped14", 27)])
def test_rank_is_the_same_with_and_without_noise(name, rank, request):
    bench = request.getfixturevalue(name)
    clean = bench.measure()
    rng = np.random.default_rng(11)
    assert fit(bench.robot, clean).rank == rank
    for _ in range(6):
        assert fit(bench.robot, bench.noisy(clean, rng)).rank == rank


@pytest.mark.parametrize("name", ["table1", "biped14"])
def test_estimates_scatter_as_their_covariance_says(name, request):
    bench = request.getfixturevalue(name)
    clean, rng = bench.measure(), np.random.default_rng(21)
    draws, chi2 = [], []
    for _ in range(60):
        found = fit(bench.robot, bench.noisy(clean, rng))
        deviation = (found.theta - found.unknowns.cad) / found.unknowns.scale
        inverse = np.linalg.pinv(
            found.seen.T
            @ (found.cov / np.outer(found.unknowns.scale, found.unknowns.scale))
            @ found.seen
        )
        a = found.seen.T @ deviation
        draws.append(a @ inverse @ a / found.rank)
        chi2.append(found.chi2)
    n = len(draws)
    low, high = chi2_distribution.ppf([1e-4, 1 - 1e-4], n * found.rank) / (n * found.rank)
    assert low < np.mean(draws) < high
    low, high = chi2_distribution.ppf([1e-4, 1 - 1e-4], n * found.dof) / n
    assert low < np.mean(chi2) < high


def test_a_level_floor_hides_the_height_of_the_standing_feet_and_a_slope_shows_it(table1):
    names = ("l_foot z", "r_foot z")
    flat = fit(table1.robot, table1.measure())
    index = [flat.unknowns.names.index(n) for n in names]
    assert flat.visibility(np.eye(flat.unknowns.size))[index].min() > 0.99
    words = {u.words: u.remedy for u in unseen_directions(flat)}
    assert "slope" in words["l_foot z is not seen at all"]
    sloped = [replace(p, pose=100 + p.pose, floor_pitch=0.05) for p in table1.plan[:6:2]]
    tilted = fit(table1.robot, table1.measure([*table1.plan, *sloped]))
    assert tilted.rank == flat.rank + 1
    both = np.zeros(flat.unknowns.size)
    both[index] = 1.0
    assert tilted.visibility(both) < 1e-6


def test_adding_a_pose_never_lowers_the_rank(biped14):
    table = biped14.measure()
    ranks = [fit(biped14.robot, table.select(range(n))).rank for n in range(1, len(table), 6)]
    assert ranks == sorted(ranks)


def test_a_direction_called_unseen_moves_no_row(biped14):
    found = fit(biped14.robot, biped14.measure())
    moved = replace(
        found.unknowns.robot,
        tree=_with_theta(
            found.unknowns, found.unknowns.cad + found.unknowns.scale * found.unseen[:, 0]
        ),
    )
    table, other = biped14.measure(), biped14.measure(true_robot=moved)
    for sensor in table.wrench:
        stands = [i for i, s in enumerate(table.support) if s != "none"]
        total = sum(table.wrench[s][stands, 2] for s in table.wrench)
        np.testing.assert_allclose(
            sum(other.wrench[s][stands, 2] for s in table.wrench), total, atol=1e-6
        )
        single = [i for i, s in enumerate(table.support) if s == sensor[0].replace("l", "left")]
        np.testing.assert_allclose(
            other.wrench[sensor][single], table.wrench[sensor][single], atol=1e-6
        )


def _with_theta(unknowns, theta):
    h = unknowns.moments(theta)
    links = tuple(
        replace(link, com=h[k] / link.mass) if link.mass > 0 else link
        for k, link in enumerate(unknowns.robot.tree.links)
    )
    return Tree("moved", links, unknowns.robot.tree.joints)


def test_the_fit_does_not_depend_on_the_order_of_poses(biped14):
    rng = np.random.default_rng(2)
    table = biped14.noisy(biped14.measure(), rng)
    order = rng.permutation(len(table))
    once, again = fit(biped14.robot, table), fit(biped14.robot, table.select(order))
    np.testing.assert_allclose(once.theta, again.theta, atol=1e-9)
    assert once.chi2 == pytest.approx(again.chi2, rel=1e-9)


def test_combinations_have_the_true_values_within_their_sigmas(table1):
    rng = np.random.default_rng(9)
    found = fit(table1.robot, table1.noisy(table1.measure(), rng))
    for combination in combinations_of(found):
        row = np.array([combination.coefficients.get(n, 0.0) for n in found.unknowns.names])
        truth = float(row @ found.unknowns.cad)
        assert abs(combination.value - truth) < 4.5 * combination.sigma


def test_sensitivity_is_the_derivative_of_the_estimate(table1):
    rng = np.random.default_rng(6)
    table = table1.noisy(table1.measure(), rng)
    found = fit(table1.robot, table)
    for sensor, axis, row in (("l_foot", 4, 3), ("r_foot", 2, 7)):
        step = 0.002
        moved = []
        for sign in (1, -1):
            w = {s: v.copy() for s, v in table.wrench.items()}
            w[sensor][row, axis] += sign * step
            moved.append(fit(table1.robot, replace(table, wrench=w)).theta)
        column = 6 * list(table.wrench).index(sensor) + axis
        slope = (moved[0] - moved[1]) / (2 * step)
        seen = found.seen.T / found.unknowns.scale * found.singular[:, None]
        wanted = seen @ found.sensitivity[0][row, :, column]
        # First order: the weights and the adjusted inputs move a little too.
        np.testing.assert_allclose(seen @ slope, wanted, atol=0.05 * np.abs(wanted).max())


def test_a_hanging_robot_alone_is_refused(biped14):
    hanging = [p for p in biped14.plan if p.support == "none"]
    with pytest.raises(RankError, match="no pose in which a foot"):
        fit(biped14.robot, biped14.measure(hanging))


def test_one_shape_determines_the_mass_and_two_components_only(table1):
    plan = [PlannedPose(i, table1.pose()) for i in (1, 2, 3)]
    found = fit(table1.robot, table1.measure(plan))
    assert found.rank == 3


def test_iteration_ends_when_every_direction_has_settled(table1, odd, monkeypatch):
    clean = table1.measure()
    cov = {name: 100.0 * c for name, c in clean.wrench_cov.items()}
    table = odd.noisy(
        replace(clean, wrench_cov=cov, q_cov=100.0 * clean.q_cov), np.random.default_rng(4)
    )
    found = fit(table1.robot, table)
    monkeypatch.setattr("comcal.identify.adjust.CONVERGED", 1e-9)
    monkeypatch.setattr("comcal.identify.adjust.ITERATIONS", 30)
    settled = fit(table1.robot, table)
    assert found.iterations < settled.iterations
    in_sigmas = (found.theta - settled.theta) / found.unknowns.scale @ found.seen * found.singular
    assert np.abs(in_sigmas).max() < 1e-3
