# SPDX-License-Identifier: Apache-2.0
"""The built-in world obeys statics, as an independent rigid-body library sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import NotBalancedError, UsageError
from comcal.measure.plan import DOUBLE, NONE, PlannedPose
from comcal.robot.frames import skew
from comcal.robot.kinematics import place_links
from comcal.robot.model import Base
from comcal_sims.builtin_world import BuiltinWorld, static_state
from comcal_sims.contact import corner_forces
from comcal_sims.robots.table1 import Table1Parameters, slope_plan

pin = pytest.importorskip("pinocchio", reason="the oracle is not installed")

GRAVITY = 9.81


def _first(generated, support):
    return next(pose for pose in generated.plan if pose.support == support)


def _sensor_in_world(robot, state, name):
    """Axes and origin of a sensor frame in the world."""
    R, p = (a[0] for a in place_links(robot.tree, state.q).joint(robot.sensors[name].joint))
    T = state.T_world_base
    return T[:3, :3] @ R, T[:3, :3] @ p + T[:3, 3]


def _carried_wrench(robot, state):
    """Sum of the sensors' wrenches in the world, about the world's origin."""
    force, moment = np.zeros(3), np.zeros(3)
    for name, wrench in state.wrenches.items():
        R, p = _sensor_in_world(robot, state, name)
        f, m = R @ wrench[:3], R @ wrench[3:]
        force, moment = force + f, moment + m + np.cross(p, f)
    return force, moment


def _pinocchio(robot):
    model = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    model.gravity.linear = np.array([0.0, 0.0, -robot.gravity])
    return model


def _held_by_base_and_joints(robot, model, state):
    """What base (6) and joints must exert besides the floor, by the library's own kinematics."""
    data = model.createData()
    q = pin.neutral(model)
    T = state.T_world_base
    q[:7] = pin.SE3ToXYZQUAT(pin.SE3(T[:3, :3].copy(), T[:3, 3].copy()))
    for name, angle in zip(robot.tree.joint_names, state.q, strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = angle
    # Contact wrenches of the floor, from the readings alone: reading minus weight of the plate.
    pin.framesForwardKinematics(model, data, q)
    torques = pin.computeGeneralizedGravity(model, data, q).copy()
    for name, sensor in robot.sensors.items():
        frame = model.getFrameId(sensor.joint)
        R = data.oMf[frame].rotation
        below = robot.below_cut[name]
        weight = R.T @ [0.0, 0.0, -robot.gravity * robot.tree.masses[below].sum()]
        com = robot.tree.masses[below] @ robot.tree.coms[below] / robot.tree.masses[below].sum()
        floor = state.wrenches[name] - np.concatenate([weight, np.cross(com, weight)])
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
        torques -= J.T @ floor
    joints = [model.joints[model.getJointId(name)].idx_v for name in robot.tree.joint_names]
    return torques[:6], torques[joints]


def test_torques_and_wrenches_agree_with_an_independent_library(generated):
    model = _pinocchio(generated.robot)
    for pose in generated.plan:
        state = static_state(generated.robot, pose)
        base, joints = _held_by_base_and_joints(generated.robot, model, state)
        assert state.torques == pytest.approx(joints, abs=1e-9), pose.pose
        if pose.support != NONE:
            assert base == pytest.approx(np.zeros(6), abs=1e-9), pose.pose


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.02, -0.03)])
def test_readings_carry_the_weight_above_the_cuts_through_its_com(generated, roll, pitch):
    robot = generated.robot
    carried = ~np.any(list(robot.below_cut.values()), axis=0)
    weight = GRAVITY * robot.tree.masses[carried].sum()
    for pose in generated.plan:
        if pose.support == NONE:
            continue
        state = static_state(robot, replace(pose, floor_roll=roll, floor_pitch=pitch))
        force, moment = _carried_wrench(robot, state)
        assert force == pytest.approx([0, 0, weight], abs=1e-9)
        T = state.T_world_base
        coms = place_links(robot.tree, pose.q).coms[0, carried] @ T[:3, :3].T + T[:3, 3]
        com = robot.tree.masses[carried] @ coms / robot.tree.masses[carried].sum()
        assert moment == pytest.approx(np.cross(com, [0, 0, weight]), abs=1e-9)


def test_the_true_com_is_that_of_the_kinematics(generated):
    for pose in generated.plan[:3]:
        state = static_state(generated.robot, pose)
        T = state.T_world_base
        com = place_links(generated.robot.tree, pose.q).total_com()[0]
        assert state.com == pytest.approx(T[:3, :3] @ com + T[:3, 3], abs=1e-12)


@pytest.mark.parametrize(("support", "lifted"), [("left", "r_foot"), ("right", "l_foot")])
def test_a_lifted_foot_reads_only_the_weight_of_its_sole(biped14, support, lifted):
    robot = biped14.robot
    state = static_state(robot, _first(biped14, support))
    R, _ = _sensor_in_world(robot, state, lifted)
    expected = R.T @ [0.0, 0.0, -GRAVITY * 0.3]
    assert state.wrenches[lifted][:3] == pytest.approx(expected, abs=1e-12)
    assert state.wrenches[lifted][3:] == pytest.approx(
        np.cross([0.03, 0.0, -0.015], expected), abs=1e-12
    )


def test_a_hanging_robot_is_held_by_its_base(biped14):
    robot = biped14.robot
    pose = _first(biped14, NONE)
    state = static_state(robot, pose)
    for wrench in state.wrenches.values():
        assert np.linalg.norm(wrench[:3]) == pytest.approx(GRAVITY * 0.3)
    fixed = static_state(replace(robot, base=Base.FIXED), replace(pose, support=DOUBLE))
    assert np.array_equal(fixed.torques, state.torques)


@given(roll=st.floats(-0.1, 0.1), pitch=st.floats(-0.1, 0.1))
@settings(max_examples=15)
def test_a_slope_leans_gravity_in_the_stance_frame(table1, roll, pitch):
    pose = replace(table1.plan[0], q=np.zeros(6), floor_roll=roll, floor_pitch=pitch)
    state = static_state(table1.robot, pose)
    fx, fy, fz = state.wrenches["l_foot"][:3] + state.wrenches["r_foot"][:3]
    assert fx / fz == pytest.approx(-np.tan(pitch) / np.cos(roll), abs=1e-12)
    assert fy / fz == pytest.approx(np.tan(roll), abs=1e-12)


def test_two_slopes_give_the_height_of_the_com(table1):
    plan = slope_plan(Table1Parameters(), pitch=0.06, bend=0.7)
    for level, down, up in zip(plan[::3], plan[1::3], plan[2::3], strict=True):
        lines = []
        for pose in (down, up):
            state = static_state(table1.robot, pose)
            fx, _, fz, _, ty, _ = state.wrenches["l_foot"] + state.wrenches["r_foot"]
            lines.append((-ty / fz, fx / fz))
        (alpha_down, beta_down), (alpha_up, beta_up) = lines
        height = (alpha_down - alpha_up) / (beta_up - beta_down)
        robot = table1.robot
        carried = ~np.any(list(robot.below_cut.values()), axis=0)
        placements = place_links(robot.tree, level.q)
        R, sensor = (a[0] for a in placements.joint("l_foot_ft"))
        com = robot.tree.masses[carried] @ placements.coms[0, carried]
        com = R.T @ (com / robot.tree.masses[carried].sum() - sensor)
        assert height == pytest.approx(com[2], abs=1e-9)
        assert alpha_down + beta_down * height == pytest.approx(com[0], abs=1e-9)


def test_a_level_pelvis_feels_gravity_upwards(biped14):
    state = static_state(biped14.robot, biped14.plan[0])
    assert state.imu == pytest.approx([0.0, 0.0, GRAVITY])
    slope = replace(biped14.plan[0], floor_pitch=0.05)
    assert static_state(biped14.robot, slope).imu == pytest.approx(
        [-GRAVITY * np.sin(0.05), 0.0, GRAVITY * np.cos(0.05)]
    )


def test_a_robot_that_would_fall_is_refused_with_the_distance(table1):
    shin = np.deg2rad(-50.0)  # CoM 113 mm behind the ankles, the heels end at 80
    q = np.array([0.0, 0.0, -shin, 0.0, 0.0, -shin])
    pose = PlannedPose(7, q)
    with pytest.raises(NotBalancedError, match=r"pose 7: .*CoM 3\d\.\d mm outside"):
        static_state(table1.robot, pose)


def test_time_passes_but_nothing_moves(table1):
    world = BuiltinWorld(table1.robot)
    with pytest.raises(UsageError, match="place a pose first"):
        world.state()
    world.place(table1.plan[0])
    before = world.state()
    world.advance(0.5)
    after = world.state()
    assert after.t - before.t == pytest.approx(0.5)
    assert all(np.array_equal(after.wrenches[s], before.wrenches[s]) for s in before.wrenches)
    world.place(table1.plan[1])
    assert world.state().t == after.t


SQUARE = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], dtype=float)
APART = np.array([0.0, 3.0])
FEET = np.column_stack([np.vstack([SQUARE + APART, SQUARE - APART]) / 10, np.zeros(8)])
UP = np.array([0.0, 0.0, 1.0])


@given(x=st.floats(-0.08, 0.08), y=st.floats(-0.38, 0.38))
@settings(max_examples=30)
def test_corners_carry_any_balanced_load_without_pulling(x, y):
    force = np.array([5.0, -3.0, 100.0])
    moment = np.cross([x, y, 0.0], force) + 0.4 * UP
    forces = corner_forces(FEET, UP, force, moment)
    assert forces.sum(axis=0) == pytest.approx(force, abs=1e-9)
    assert np.einsum("nij,nj->i", skew(FEET), forces) == pytest.approx(moment, abs=1e-9)
    assert forces[:, 2].min() >= -1e-6


def test_a_symmetric_load_is_shared_equally():
    forces = corner_forces(FEET, UP, 80.0 * UP, np.zeros(3))
    assert forces == pytest.approx(np.tile(10.0 * UP, (8, 1)), abs=1e-12)
