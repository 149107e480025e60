# SPDX-License-Identifier: Apache-2.0
"""Intervals of parameters are as wide as their errors: no less, and no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import catalogue
from comcal.diagnose.evidence import whole
from comcal.diagnose.metric import metric, products
from comcal.diagnose.naming import about_causes, name_causes
from comcal.diagnose.scene import Scene, scene
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.model import Robot
from comcal.statics.torque_rows import motor_torque_factors

DRAWS = 300


def looked_at(robot: Robot, table: PoseTable) -> Scene:
    return scene(catalogue(candidates(robot, table), robot), (Assumed(robot), table))


@pytest.fixture(scope="module")
def about(biped14) -> Scene:
    rng = np.random.default_rng(3)
    table = biped14.noisy(biped14.measure(biped14.plan[::4]), rng)
    sides = rng.choice([-1.0, 1.0], table.q.shape)
    return looked_at(
        biped14.robot,
        replace(
            table,
            approach=sides,
            current=table.torque,
            current_var=table.torque_var,
            torque=np.full_like(table.torque, np.nan),
        ),
    )


@pytest.mark.parametrize("name", ["ft_bias@l_foot", "torque_constant@l_knee", "imu_mounting"])
def test_the_interval_is_that_of_fault_and_healthy_part_together(about: Scene, name: str) -> None:
    """Nobody can tell the two from each other, and a model needs their sum.

    The healthy part once counted as an error: the offset of a sensor that noise lets be known to
    0.02 N was stated within 0.2 N.
    """
    i = about.of.index[name]
    part, rng = about.of.slices[i], np.random.default_rng(11)
    spread = about.of.spread({}, (i,))
    assert np.all(spread[part] > about.of.fault[part])  # it has a healthy part
    z = list[np.ndarray]()
    for _ in range(DRAWS):
        true = spread * rng.standard_normal(len(spread))
        r = about.X @ true + rng.standard_normal(len(about.r))
        found = whole(about.of, (i,), products(about.X, r), {})
        z.append((found.coordinates - true[part]) / np.sqrt(np.diag(found.cov)))
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / DRAWS))


def test_a_parameter_at_its_bound_keeps_its_healthy_spread(about: Scene) -> None:
    """Friction that grows with the load alone: that there is no other was certain."""
    i = about.of.index["joint_friction@l_knee"]
    part, p = about.of.slices[i], len(about.of.fault)
    assert about.of.candidates[i].keys == ("coulomb", "load_factor")
    true = np.zeros(p)
    true[part] = [-0.1, 0.1]
    found = whole(about.of, (i,), products(about.X, about.X @ true), {})
    assert found.coordinates[0] == 0.0
    healthy, size = about.of.healthy[part][0], about.of.fault[part][1]
    # As if it were off by what is healthy, to either side.
    beside = about.of.spread({})
    beside[part] = 0.0
    alone = metric(products(about.X, about.r), beside)
    left = np.linalg.inv(alone.K[part, part] + np.diag([healthy**-2, size**-2]))
    np.testing.assert_allclose(np.diag(found.cov), np.diag(left))
    assert 0.0 < found.cov[0, 0] < healthy**2


@pytest.mark.parametrize("joint", ["l_knee", "r_hip_pitch"])
def test_a_healthy_percent_of_a_constant_does_not_move_a_large_offset(biped14, joint: str) -> None:
    """Torque is kt (1 + e) (i - offset): the offset is what it is, whatever e.

    As long as e was linearised about the robot without the offset, e times the offset was missing.
    """
    robot, e, offset, sigma = biped14.robot, 0.01, 0.6, 0.004
    exact = biped14.measure(biped14.plan[::2])
    k = robot.tree.joint_names.index(joint)
    current = exact.torque / motor_torque_factors(robot)
    current[:, k] = current[:, k] / (1.0 + e) + offset
    table = replace(
        exact,
        torque=np.full_like(current, np.nan),
        current=current,
        current_var=np.full_like(current, sigma**2),
    )
    named = about_causes(name_causes(looked_at(robot, table)))
    (i,) = named.causes
    assert named.scene.of.candidates[i].name == f"current_offset@{joint}"
    assert named.fit.coordinates[0] == pytest.approx(offset, abs=0.25 * e * offset)
