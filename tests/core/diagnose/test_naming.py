# SPDX-License-Identifier: Apache-2.0
"""The cause that is there is named, alone, with its parameters; healthy readings have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import catalogue
from comcal.diagnose.diagnose import diagnose
from comcal.diagnose.diagnosis import Verdict
from comcal.diagnose.evidence import explained
from comcal.diagnose.metric import metric, products
from comcal.diagnose.naming import Named, name_causes
from comcal.diagnose.scene import Scene, scene
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.model import Robot


def names(named: Named) -> list[str]:
    return [named.scene.of.candidates[i].name for i in named.causes]


def looked_at(robot: Robot, table: PoseTable) -> Scene:
    return scene(catalogue(candidates(robot, table), robot), (Assumed(robot), table))


@pytest.fixture
def healthy(biped14) -> PoseTable:
    return biped14.measure(biped14.plan[::4])


def heavier(robot: Robot, name: str, mass: float, at: np.ndarray) -> Robot:
    links = tuple(
        replace(k, mass=k.mass + mass, com=(k.mass * k.com + mass * at) / (k.mass + mass))
        if k.name == name
        else k
        for k in robot.tree.links
    )
    return replace(robot, tree=replace(robot.tree, links=links))


def test_whitened_noise_is_white(biped14, healthy):
    """The covariance is that of the noise drawn: chi2 over its degrees of freedom is one."""
    rng = np.random.default_rng(4)
    total, freedom = 0.0, 0
    for _ in range(4):
        about = looked_at(biped14.robot, biped14.noisy(healthy, rng))
        total += about.products.rr
        freedom += about.products.rows
    assert total / freedom == pytest.approx(1.0, abs=4 * np.sqrt(2 / freedom))


def test_inner_products_are_those_of_the_inverse_covariance():
    rng = np.random.default_rng(0)
    X, r, spread = rng.standard_normal((30, 5)), rng.standard_normal(30), np.array([0, 2, 0, 1, 3])
    C = np.eye(30) + (X * spread**2) @ X.T
    found = metric(products(X, r), spread.astype(float))
    np.testing.assert_allclose(found.K, X.T @ np.linalg.solve(C, X), atol=1e-9)
    np.testing.assert_allclose(found.b, X.T @ np.linalg.solve(C, r), atol=1e-9)
    assert found.rr == pytest.approx(r @ np.linalg.solve(C, r))
    assert found.log_det == pytest.approx(np.linalg.slogdet(C)[1])


def test_log_odds_are_the_ratio_of_two_normal_densities():
    rng = np.random.default_rng(1)
    A, r, F = rng.standard_normal((20, 3)), rng.standard_normal(20), np.array([1.0, 2.0, 0.5])
    C = np.eye(20) + (A * F**2) @ A.T
    expected = -0.5 * (r @ np.linalg.solve(C, r) + np.linalg.slogdet(C)[1] - r @ r)
    assert explained(A.T @ A, A.T @ r, F).log_odds == pytest.approx(expected)


def test_a_cause_that_would_need_a_negative_mass_is_impossible():
    K, b, one = np.array([[4.0]]), np.array([-3.0]), np.ones(1)
    yes = np.array([True])
    assert explained(K, b, one).log_odds > 0.0
    assert explained(K, b, one, yes, yes).log_odds == -np.inf


def test_columns_are_the_derivatives_of_the_residuals(biped14, healthy):
    """Every coordinate of every candidate: by elementary parts, and by the residuals themselves."""
    table = biped14.noisy(healthy, np.random.default_rng(8)).select(range(0, len(healthy), 3))
    about = looked_at(biped14.robot, table)
    for candidate, part in zip(about.of.candidates, about.of.slices, strict=True):
        for k in range(len(candidate.keys)):
            size = candidate.fault[k] * 1e-3
            x = size * np.eye(len(candidate.keys))[k]
            ahead, behind = (
                np.nan_to_num(
                    parity(*candidate.effect.correct(Assumed(biped14.robot), table, c)).values
                )
                for c in (candidate.change(x), candidate.change(-x))
            )
            slope = (behind - ahead) / (2.0 * size)
            error = np.linalg.norm(about.raw[:, part.start + k] - slope)
            assert error <= 2e-3 * np.linalg.norm(slope) + 1e-6 / candidate.fault[k], (
                candidate.name,
                candidate.keys[k],
            )


def test_healthy_readings_name_nothing(biped14, healthy):
    found = diagnose(Assumed(biped14.robot), biped14.noisy(healthy, np.random.default_rng(1)))
    assert found.verdict is Verdict.NOTHING_WRONG
    assert found.causes == ()


def test_a_body_that_the_model_does_not_know_is_named_with_its_place(biped14):
    true = heavier(biped14.robot, "torso", 2.0, np.array([0.1, 0.0, 0.25]))
    table = biped14.measure(biped14.plan[::4], true_robot=true)
    found = diagnose(Assumed(biped14.robot), biped14.noisy(table, np.random.default_rng(2)))
    assert found.verdict is Verdict.EXPLAINED
    (cause,) = found.causes
    assert cause.name == "payload@torso"
    for key, value in {"mass": 2.0, "com_x": 0.1, "com_y": 0.0, "com_z": 0.25}.items():
        estimate = cause.estimates[key]
        assert abs(estimate.value - value) < 4.0 * estimate.sigma, key
    assert cause.gain is not None
    assert cause.gain.is_real
    # What fits worse by so much is excluded by the readings, not only for want of simplicity.
    assert all(rival.chi2_more > 100.0 for rival in cause.rivals if rival.left > 0.3)
    assert any(rival.left > 0.3 for rival in cause.rivals)


def test_a_payload_that_outweighs_its_link_is_no_mass_of_that_link(biped14):
    """Linearised about the payload, the link's CoM is where the payload is: it would be as good."""
    true = heavier(biped14.robot, "l_hip_yoke", 1.9, np.array([0.038, 0.035, -0.09]))
    table = biped14.measure(biped14.plan[::4], true_robot=true)
    found = diagnose(Assumed(biped14.robot), biped14.noisy(table, np.random.default_rng(2)))
    assert [cause.name for cause in found.causes] == ["payload@l_hip_yoke"]
    (mass,) = [r for r in found.causes[0].rivals if r.name == "link_mass@l_hip_yoke"]
    assert mass.left_sigmas > 8.0
    assert found.verdict is Verdict.EXPLAINED


def test_a_turned_sensor_is_told_from_a_sloping_floor(biped14, healthy):
    table = biped14.noisy(healthy, np.random.default_rng(3))
    turn = 0.03
    w = table.wrench["l_foot"].copy()
    c, s = np.cos(turn), np.sin(turn)
    for k in (0, 3):
        w[:, k + 1], w[:, k + 2] = (
            c * w[:, k + 1] - s * w[:, k + 2],
            s * w[:, k + 1] + c * w[:, k + 2],
        )
    table = replace(table, wrench={**table.wrench, "l_foot": w})
    named = name_causes(looked_at(biped14.robot, table))
    assert names(named) == ["ft_mounting@l_foot"]


def test_a_hand_on_a_rail_is_found_in_its_pose(biped14, healthy):
    """The force is put into the readings of one pose by hand: both feet carry less."""
    table = biped14.noisy(healthy, np.random.default_rng(5))
    pose = table.support.index("double")
    w = {s: v.copy() for s, v in table.wrench.items()}
    for sensor in w:
        w[sensor][pose, 2] -= 10.0
    named = name_causes(looked_at(biped14.robot, replace(table, wrench=w)))
    assert len(named.causes) == 1
    assert f"in pose {table.pose[pose]}" in names(named)[0]


def test_links_that_turn_about_one_point_are_one_target_of_a_force(biped14, healthy):
    robot = biped14.robot
    pulled = {c.target for c in candidates(robot, healthy) if c.effect.name == "cable_pull"}
    assert pulled == {"pelvis", "torso", "l_arm", "r_arm"} | {
        f"{side}_{part}" for side in "lr" for part in ("thigh", "shin", "foot", "sole")
    }
    assert "l_hip_yoke" in {c.target for c in candidates(robot, healthy) if c.effect.moments}


def test_a_sensor_between_them_tells_on_which_link_a_force_acts(biped14, healthy):
    robot = biped14.robot
    cut = replace(robot.sensors["l_foot"], joint="l_ankle_roll")
    turned = replace(robot, sensors={**robot.sensors, "l_foot": cut})
    pulled = {c.target for c in candidates(turned, healthy) if c.effect.name == "cable_pull"}
    assert {"l_ankle_yoke", "l_foot", "r_foot"} <= pulled
    assert "r_ankle_yoke" not in pulled
