# SPDX-License-Identifier: Apache-2.0
"""Joint torques, currents, free masses and unknown tares in the all-data fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import norm

from comcal.effects.extend import extend
from comcal.errors import NotFiniteError
from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.calibration import Verdict, calibrate
from comcal.identify.groups import Rows, groups_of
from comcal.identify.linearise import linearise
from comcal.identify.scope import Scope, scoped
from comcal.identify.solution import solve_all
from comcal.identify.torque_readings import torque_readings
from comcal.identify.words import unseen_directions
from comcal.measure.table import PoseTable
from comcal.robot.changes import Change
from comcal.robot.changes_yaml import KnownChange
from comcal.robot.draw import links_below_cuts
from comcal.robot.model import Robot, Tolerances
from comcal.statics.torque_rows import motor_torque_factors

EVERYTHING = Scope(torques=True, free_masses=True)


def other_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """A true robot with other masses (10 %) and CoMs (20 mm) above the cuts than the URDF says."""
    below = links_below_cuts(robot)
    links = tuple(
        link
        if below[k] or link.mass < 0.01
        else replace(
            link,
            mass=link.mass * rng.uniform(0.9, 1.1),
            com=link.com + rng.uniform(-0.02, 0.02, 3),
        )
        for k, link in enumerate(robot.tree.links)
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def fit(robot: Robot, table: PoseTable, scope: Scope) -> Adjustment:
    return adjust(robot, *scoped(robot, table, scope))


def distance(found: Adjustment, wanted: np.ndarray) -> float:
    """Squared distance from the truth along what is seen, in units of the claimed covariance."""
    a = found.seen.T @ ((found.theta - wanted) / found.unknowns.scale)
    return float(np.sum((found.singular * a) ** 2))


def test_masses_and_moments_far_from_the_urdf_come_back_exactly_where_they_are_seen(biped14):
    true = other_robot(biped14.robot, np.random.default_rng(3))
    table = biped14.measure(biped14.plan[::2], true_robot=true)
    found = fit(biped14.robot, table, EVERYTHING)
    assert any(group.layout.hangs for group in found.groups)
    wanted = replace(found.unknowns, robot=true).cad
    error = (found.theta - wanted) / found.unknowns.scale
    assert np.abs(found.seen.T @ error).max() < 1e-7
    assert found.chi2 < 1e-6


def test_torques_add_no_rank_to_foot_wrenches_but_sharpen_weak_directions(biped14):
    standing = [pose for pose in biped14.plan if pose.support != "none"]
    table = biped14.measure(standing)
    alone = fit(biped14.robot, table, Scope())
    both = fit(biped14.robot, table, Scope(torques=True))
    assert both.rank == alone.rank
    assert both.condition < alone.condition
    assert np.all(np.diag(both.cov) <= np.diag(alone.cov) * (1 + 1e-9))


@pytest.mark.parametrize(
    "scope", [Scope(torques=True), EVERYTHING, Scope(torques=True, unknown_tares=True)]
)
def test_estimates_scatter_as_their_covariance_says(scope, biped14):
    clean, rng = biped14.measure(biped14.plan[::3]), np.random.default_rng(5)
    found = [fit(biped14.robot, biped14.noisy(clean, rng), scope) for _ in range(12)]
    rank, dof = found[0].rank, found[0].dof
    assert {f.rank for f in found} == {rank}
    for values, freedom in (
        ([distance(f, f.unknowns.cad) for f in found], rank),
        ([f.chi2 for f in found], dof),
    ):
        low, high = chi2_distribution.ppf([1e-4, 1 - 1e-4], len(found) * freedom)
        assert low < np.sum(values) < high


def test_diagonal_weights_fail_the_coverage_line(biped14):
    """One wrench's noise is in the balance and in all torque rows of its leg, an encoder's in all.

    What an estimate with diagonal weights scatters by, S being the rows' whole covariance, is
    (A'DA)^-1 A'D S D A (A'DA)^-1; it claims (A'DA)^-1.
    """
    robot = biped14.robot
    table = biped14.measure([p for p in biped14.plan if p.support != "none"])
    unknowns, groups = scoped(robot, table, Scope(torques=True))
    found = adjust(robot, unknowns, groups)
    basis = found.seen * unknowns.scale[:, None]
    single = np.eye(unknowns.size)[found.visibility(np.eye(unknowns.size)) < 1e-3] @ basis
    assert len(single) > 20

    def coverage(weights) -> float:
        information, scatter = np.zeros((2, found.rank, found.rank))
        for group in groups:
            a = linearise(robot, unknowns, group, unknowns.cad, group.inputs)
            A, covariance = a.A @ basis, np.linalg.inv(a.W)
            D = weights(covariance)
            information = information + np.einsum("nji,njk,nkl->il", A, D, A, optimize=True)
            DA = D @ A
            scatter = scatter + np.einsum("nji,njk,nkl->il", DA, covariance, DA, optimize=True)
        claimed = np.linalg.inv(information)
        true = claimed @ scatter @ claimed
        ratio = np.diag(single @ true @ single.T) / np.diag(single @ claimed @ single.T)
        return float(np.mean(2 * norm.cdf(1.96 / np.sqrt(ratio)) - 1))

    assert coverage(np.linalg.inv) == pytest.approx(0.95, abs=1e-4)
    diagonal = coverage(lambda S: np.eye(S.shape[1]) / np.einsum("nii->ni", S)[:, None])
    assert diagonal < 0.94


def test_unknown_tares_are_found_with_the_coms_and_named_where_no_pose_separates_them(biped14):
    robot, rng = biped14.robot, np.random.default_rng(8)
    bias = {name: rng.normal(0, [5, 5, 8, 0.5, 0.5, 0.5]) for name in robot.sensors}
    clean = biped14.measure()
    table = replace(clean, wrench={s: w + bias[s] for s, w in clean.wrench.items()})
    found = fit(robot, table, Scope(unknown_tares=True))
    assert found.chi2 < 1e-6
    for sensor, value in bias.items():
        at = found.unknowns.offset_columns(sensor)
        np.testing.assert_allclose(found.theta[at], value, atol=1e-6)
    standing = [p for p in biped14.plan if p.support == "double"]
    only_double = biped14.measure(standing)
    hidden = fit(robot, only_double, Scope(unknown_tares=True))
    at = hidden.unknowns.offset_columns("l_foot")
    share = hidden.visibility(np.eye(hidden.unknowns.size)[at])
    assert share[2] > 0.5  # fz: one foot's offset against the other's, and against mass
    parts = {part for unseen in unseen_directions(hidden) for part in unseen.parts}
    assert "l_foot offset fz" in parts


def test_torques_alone_do_not_pretend_to_know_the_total_com(biped14):
    """A fit of torques can halve their error and double that of the total CoM: it must say so."""
    true = other_robot(biped14.robot, np.random.default_rng(9))
    hung = [replace(p, support="none") for p in biped14.plan]
    table = biped14.measure(hung, true_robot=true)
    result = calibrate(biped14.robot, table, scope=Scope(torques=True))
    assert result.verdict is Verdict.NOT_IDENTIFIABLE
    assert "total CoM" in result.reason
    assert result.solution is not None
    assert np.isnan(result.solution.mass)
    assert result.solution.poses == ()
    pelvis = result.solution.links[biped14.robot.tree.link_index["pelvis"]]
    assert not pelvis.identifiable.any()
    free = solve_all(biped14.robot, table, EVERYTHING)
    assert np.isnan(free.mass)


def test_a_hanging_pose_without_an_imu_is_refused(biped14):
    hung = [replace(p, support="none") for p in biped14.plan[:2]]
    table = biped14.measure(hung)
    blind = replace(table, imu=np.full_like(table.imu, np.nan))
    with pytest.raises(NotFiniteError, match="where up is"):
        groups_of(biped14.robot, blind, Rows.TORQUES)


def test_currents_count_as_torques_with_their_own_errors(biped14):
    robot = replace(
        biped14.robot,
        tolerances=Tolerances(
            other={"torque_constant": 0.02, "current_offset": 0.1, "joint_friction": 1.0}
        ),
    )
    table = biped14.measure(biped14.plan[:3])
    factor = np.array(
        [m.torque_constant * m.gear * m.sign for m in map(robot.motors.get, robot.tree.joint_names)]
    )
    approach = np.tile([1.0, -1.0, np.nan], (14, 1)).T
    currents = replace(
        table,
        current=table.torque / factor,
        current_var=np.full_like(table.q, 0.01**2),
        torque=np.full_like(table.q, np.nan),
        approach=approach,
    )
    found = torque_readings(robot, currents)
    np.testing.assert_allclose(found.value, table.torque, atol=1e-12)
    own = (0.01 * factor) ** 2
    np.testing.assert_allclose(found.variance, own + np.array([[0.0], [0.0], [1.0]]))
    np.testing.assert_allclose(found.friction, np.nan_to_num(approach))
    np.testing.assert_allclose(found.gain, 0.02 * table.torque)
    np.testing.assert_allclose(found.offset, np.tile(0.1 * factor, (3, 1)))


def test_what_a_model_says_of_a_motor_stands_instead_of_its_tolerance(biped14):
    """What was found holds the healthy part too; how well it is known is an error of its own."""
    tolerances = Tolerances(other={"torque_constant": 0.02, "joint_friction": 1.0})
    robot = replace(biped14.robot, tolerances=tolerances)
    table = biped14.measure(biped14.plan[:3])
    factor = motor_torque_factors(robot)
    currents = replace(
        table,
        current=table.torque / factor,
        current_var=np.full_like(table.q, 0.01**2),
        torque=np.full_like(table.q, np.nan),
    )
    found = Change("torque_constant", "l_knee", {"relative": 0.3})
    known = extend(robot, currents, [KnownChange(found, {"relative": 0.003})])
    knee = robot.tree.joint_names.index("l_knee")
    said = torque_readings(known.robot, known.table)
    assert known.shared == ("torque_constant@l_knee relative",)
    assert not said.gain[:, knee].any()
    others = np.delete(np.arange(len(robot.tree.joint_names)), knee)
    np.testing.assert_allclose(said.gain[:, others], 0.02 * said.value[:, others])
    # Of friction nothing was said: a band where the side is unknown.
    assert np.all(said.variance[:, knee] > 1.0)


def test_friction_cancels_when_poses_are_approached_from_both_sides(biped14):
    """A band of 1 N m where the side is unknown; one unknown number where it is recorded."""
    robot = replace(biped14.robot, tolerances=Tolerances(other={"joint_friction": 1.0}))
    plan = [p for p in biped14.plan if p.support != "none"][::3]
    table = biped14.measure([*plan, *plan])
    side = np.repeat([1.0, -1.0], len(plan))[:, None] * np.ones(14)
    nan = np.full_like(table.q, np.nan)
    factor = np.array([robot.motors[j].torque_constant for j in robot.tree.joint_names])
    gears = np.array([robot.motors[j].gear * robot.motors[j].sign for j in robot.tree.joint_names])
    currents = replace(
        table,
        pose=tuple(range(len(table))),
        current=(table.torque + 1.7 * side) / (factor * gears),
        current_var=np.full_like(table.q, 1e-6),
        torque=nan,
    )
    known = fit(robot, replace(currents, approach=side), Scope(torques=True))
    unknown = fit(robot, currents, Scope(torques=True))
    error = (known.theta - known.unknowns.cad) / known.unknowns.scale
    assert np.abs(known.seen.T @ error * known.singular).max() < 0.1
    assert known.chi2 == pytest.approx(14 * 1.7**2, rel=0.05)  # each joint's friction, against 1
    assert np.trace(known.cov) < np.trace(unknown.cov)
