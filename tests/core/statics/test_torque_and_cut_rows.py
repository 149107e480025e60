# SPDX-License-Identifier: Apache-2.0
"""Rows of torques and of cuts: true in every pose, linear in the masses, rightly differentiated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.robot.model import Base, Robot, Sensor
from comcal.statics.balance import balance_at
from comcal.statics.cut_rows import cuts_of
from comcal.statics.static_rows import (
    Model,
    RowLayout,
    row_jacobian,
    row_regressor,
    row_residual,
)
from comcal.statics.support import Carrier, carrier_of, hanging_carrier
from comcal.statics.torque_rows import motor_torque_factors, readable_joints
from comcal_sims.builtin_world import static_state

N = 4
STEP = 1e-6


def instrumented(odd, rng) -> Robot:
    """An awkward biped with sensors at a hip, a knee and an arm besides those of the feet."""
    robot = odd.odd_biped(rng)
    more = {name: Sensor(name, name) for name in ("l_hip", "r_knee", "arm")}
    return replace(robot, sensors={**robot.sensors, **more}, imu_link="forearm")


def all_rows(robot: Robot, carrier: Carrier) -> RowLayout:
    joints = tuple(int(j) for j in np.flatnonzero(readable_joints(robot, carrier)))
    return RowLayout(carrier, cuts_of(robot, carrier), joints, len(robot.tree.joint_names))


def random_inputs(layout: RowLayout, rng):
    """Inputs of N poses, away from equilibrium: nothing cancels."""
    inputs = rng.normal(0, 30, (N, layout.n_inputs))
    inputs[:, layout.q_columns] = rng.normal(0, 0.4, (N, layout.n_joints))
    if not layout.hangs:
        inputs[:, 2 : layout.q_columns.start : 6] += 200.0
    return inputs


def random_model(robot: Robot, rng) -> Model:
    n = len(robot.tree.links)
    return Model(float(rng.uniform(20, 40)), rng.normal(0, 1, (n, 3)), rng.uniform(0.5, 4, n))


def evaluate(robot: Robot, layout: RowLayout, inputs, model: Model):
    n_loaded = layout.q_columns.start
    balance = balance_at(
        robot,
        layout.carrier,
        inputs[:, layout.q_columns],
        inputs[:, :n_loaded].reshape(N, -1, 6),
        inputs[:, layout.up_columns] if layout.hangs else None,
        robot.tree.link_index["forearm"],
    )
    wrenches = inputs[:, layout.cut_columns].reshape(N, -1, 6)
    left = row_residual(layout, balance, wrenches, inputs[:, layout.torque_columns], model)
    return left, balance, wrenches


SUPPORTS = ("left", "right", "double", "none")


def carrier(robot: Robot, support: str) -> Carrier:
    return hanging_carrier(robot) if support == "none" else carrier_of(robot, support)


@pytest.mark.parametrize("support", SUPPORTS)
def test_jacobian_of_all_rows_equals_finite_differences(support, odd):
    rng = np.random.default_rng(3)
    robot = instrumented(odd, rng)
    layout = all_rows(robot, carrier(robot, support))
    inputs, model = random_inputs(layout, rng), random_model(robot, rng)
    _, balance, wrenches = evaluate(robot, layout, inputs, model)
    B = row_jacobian(layout, balance, wrenches, model)
    assert B.shape == (N, layout.n_rows, layout.n_inputs)
    assert len(layout.cuts) >= 3
    assert len(layout.torques) >= 6
    for i, step in enumerate(STEP * np.eye(layout.n_inputs)):
        slope = (
            evaluate(robot, layout, inputs + step, model)[0]
            - evaluate(robot, layout, inputs - step, model)[0]
        ) / (2 * STEP)
        np.testing.assert_allclose(B[:, :, i], slope, atol=2e-6 * np.abs(B).max())


@pytest.mark.parametrize("support", SUPPORTS)
def test_rows_are_linear_in_masses_and_first_moments(support, odd):
    rng = np.random.default_rng(4)
    robot = instrumented(odd, rng)
    layout = all_rows(robot, carrier(robot, support))
    inputs, model = random_inputs(layout, rng), random_model(robot, rng)
    carried = layout.carrier.carried
    model = replace(model, mass=float(model.masses[carried].sum()))
    left, balance, _ = evaluate(robot, layout, inputs, model)
    nothing = Model(0.0, np.zeros_like(model.h), np.zeros_like(model.masses))
    empty = evaluate(robot, layout, inputs, nothing)[0]
    by_mass, by_moment = row_regressor(layout, balance, balance.direction)
    linear = by_mass @ model.masses + np.einsum("nrki,ki->nr", by_moment, model.h)
    np.testing.assert_allclose(left, empty + linear, atol=1e-11 * np.abs(left).max())


def watched(robot: Robot) -> Robot:
    """The 64 kg biped with sensors at the left hip, the right knee and a shoulder as well."""
    more = {name: Sensor(name, name) for name in ("l_hip_pitch", "r_knee", "l_shoulder")}
    return replace(robot, sensors={**robot.sensors, **more})


@pytest.mark.parametrize("root", ["torso", "l_foot", "r_shin"])
def test_every_row_vanishes_on_the_true_robot_however_it_is_rooted(root, biped14, odd):
    """The oracle is the built-in world: it adds up loads link by link, in the world's axes."""
    robot = watched(biped14.robot)
    rooted = odd.rooted_at(robot, root)
    names = robot.tree.joint_names
    order = [names.index(name) for name in rooted.tree.joint_names]
    seen = set()
    for pose in biped14.plan[::7]:
        pose = replace(pose, q=pose.q[order])
        state = static_state(rooted, pose)
        support = carrier_of(rooted, pose.support)
        layout = all_rows(rooted, support)
        seen |= {cut.sensor for cut in layout.cuts}
        w = np.array([[state.wrenches[s] for s in support.sensors]])
        balance = balance_at(rooted, support, np.array([pose.q]), w)
        wrenches = np.array([[state.wrenches[cut.sensor] for cut in layout.cuts]])
        torques = np.array([state.torques])[:, list(layout.torques)]
        tree = rooted.tree
        carried = float(tree.masses[support.carried].sum())
        model = Model(carried, tree.masses[:, None] * tree.coms, tree.masses)
        left = row_residual(layout, balance, wrenches.reshape(1, -1, 6), torques, model)
        np.testing.assert_allclose(left, 0.0, atol=2e-9)
        assert len(layout.torques) >= 12
    assert len(seen) >= 4


def test_a_joint_between_the_standing_foot_and_its_sensor_is_not_readable(biped14):
    robot = biped14.robot
    at_hip = replace(robot, sensors={**robot.sensors, "l_foot": Sensor("l_foot", "l_hip_pitch")})
    left = dict(
        zip(
            at_hip.tree.joint_names,
            readable_joints(at_hip, carrier_of(at_hip, "left")),
            strict=True,
        )
    )
    assert not left["l_knee"]
    assert left["r_knee"]
    assert left["l_hip_pitch"]  # the sensor reads the very torque of this joint


def test_a_crane_may_hold_the_trunk_so_only_unbranched_limbs_are_read(odd):
    robot = odd.odd_biped(np.random.default_rng(0))
    assert readable_joints(robot, hanging_carrier(robot)).all()
    rooted = odd.rooted_at(robot, "l_thigh")  # now the hip carries the trunk with all other limbs
    names = rooted.tree.joint_names
    held = dict(zip(names, readable_joints(rooted, hanging_carrier(rooted)), strict=True))
    assert not held["l_hip"]
    assert held["l_knee"]
    assert held["r_knee"]
    fixed = replace(rooted, base=Base.FIXED)
    assert readable_joints(fixed, hanging_carrier(fixed)).all()


def test_motor_torque_is_current_times_constant_gear_and_sign(biped14):
    factors = motor_torque_factors(biped14.robot)
    for factor, name in zip(factors, biped14.robot.tree.joint_names, strict=True):
        motor = biped14.robot.motors[name]
        assert factor == motor.torque_constant * motor.gear * motor.sign
