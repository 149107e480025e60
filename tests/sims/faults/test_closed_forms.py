# SPDX-License-Identifier: Apache-2.0
"""What every effect does to the readings, against closed forms; in plain statics, so exact.

That engines do the same is in test_worlds_agree.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.measure.source import Block, SourceRequest
from comcal.robot.changes_text import parse_change
from comcal.robot.frames import rotation_about
from comcal.robot.kinematics import place_links
from comcal_sims import sources
from comcal_sims.faults.stiction import BREAK_AWAY, Stiction

Measure = Callable[..., list[Block]]
G = 9.81


@pytest.fixture(scope="module")
def robot(biped14: Any) -> Any:
    return biped14.robot


@pytest.fixture(scope="module")
def measure(biped14: Any) -> Measure:
    """Return noise-free samples of poses, by id, under the effects given."""

    def run(*effects: str, poses: Sequence[int], **options: Any) -> list[Block]:
        request = SourceRequest(
            biped14.robot, seed=1, noise=False, effects=effects, plan=biped14.plan, **options
        )
        blocks = []
        with sources.open_builtin(request) as source:
            for pose in biped14.plan:
                if pose.pose in poses:
                    source.move_to(pose)
                    blocks.append(source.read(0.02))
        return blocks

    return run


def joint(robot: Any, name: str) -> int:
    return robot.tree.joint_names.index(name)


def change_of(measure: Measure, pose: int, effect: str) -> tuple[Block, Block]:
    (before,), (after,) = measure(poses=[pose]), measure(effect, poses=[pose])
    return before, after


BENT = 18
"""Stands on the left foot with a loaded knee."""

# Poses of the plan: 3 stands on both feet, 20 on the left, 30 on the right one, 39 hangs.


@pytest.mark.parametrize("pose", [3, 20, 30])
def test_payload_adds_its_weight_and_its_moment(measure: Measure, robot: Any, pose: int) -> None:
    before, after = change_of(measure, pose, "payload@torso:mass=5,com_x=0.1,com_z=0.2")
    added = sum(after.wrenches[s] - before.wrenches[s] for s in robot.sensors)
    np.testing.assert_allclose(np.linalg.norm(added[-1, :3]), 5 * G, rtol=1e-9)
    # at the waist pitch joint: gravity at the lever of the payload, in the axes of the torso
    up = after.imu[-1] / G
    lean = after.q[-1, [joint(robot, "waist_roll"), joint(robot, "waist_pitch")]]
    R = rotation_about([1, 0, 0], lean[0]) @ rotation_about([0, 1, 0], lean[1])
    moment = np.cross([0.1, 0.0, 0.2], 5 * G * (R.T @ up))
    i = joint(robot, "waist_pitch")
    motor = robot.motors["waist_pitch"]
    per_ampere = motor.torque_constant * motor.gear * motor.sign
    torque = (after.currents - before.currents)[-1, i] * per_ampere
    assert torque == pytest.approx(moment[1], rel=1e-9)


def test_springs_give_by_torque_over_stiffness(measure: Measure, robot: Any) -> None:
    """On one foot nothing else gives: the pelvis tilts by what knee and ankle give."""
    before, after = change_of(measure, BENT, "joint_compliance@l_knee:stiffness=4000")
    i = joint(robot, "l_knee")
    motor = robot.motors["l_knee"]
    torque = after.currents[-1, i] * motor.torque_constant * motor.gear * motor.sign
    np.testing.assert_allclose(after.q[-1], before.q[-1], atol=1e-9)  # encoders see nothing
    tilt = np.arccos(before.imu[-1] @ after.imu[-1] / G**2)
    # the pelvis rides on the knee, whose axis is level here but for the roll of the leg
    assert tilt == pytest.approx(abs(torque) / 4000, rel=0.02)
    assert tilt > 1e-3
    stiff = change_of(measure, BENT, "joint_compliance@l_knee:stiffness=8000")[1]
    assert np.arccos(before.imu[-1] @ stiff.imu[-1] / G**2) == pytest.approx(tilt / 2, rel=0.05)


def test_offset_and_springs_have_the_signs_of_the_contract(measure: Measure, robot: Any) -> None:
    """q_true = q_encoder + offset - tau / stiffness: such an offset undoes a spring."""
    (before,) = measure(poses=[BENT])
    i = joint(robot, "l_knee")
    motor = robot.motors["l_knee"]
    torque = float(before.currents[-1, i] * motor.torque_constant * motor.gear * motor.sign)
    spring = "joint_compliance@l_knee:stiffness=4000"
    (undone,) = measure(spring, f"joint_offset@l_knee:offset={torque / 4000!r}", poses=[BENT])
    np.testing.assert_allclose(undone.imu[-1], before.imu[-1], atol=1e-4)
    (moved,) = measure("joint_offset@l_knee:offset=0.01", poses=[BENT])
    true = moved.q[-1].copy()
    true[i] += 0.01
    # gravity in the axes of the foot, which stays flat, over the true knee
    up = [
        place_links(robot.tree, q).link("l_foot")[0][0].T @ block.imu[-1]
        for q, block in ((true, moved), (before.q[-1], before))
    ]
    np.testing.assert_allclose(up[0], up[1], atol=1e-9)


def test_play_is_a_step_at_torque_reversal(measure: Measure, robot: Any) -> None:
    """The load pushes the joint to one stop or the other: half the width, sign of gravity."""
    i = joint(robot, "l_shoulder")
    arm = robot.tree.link_index["l_arm"]
    plays = []
    for pose in (20, 24, 30, 39):
        before, after = change_of(measure, pose, "backlash@l_shoulder:half_width=0.01")
        offset = change_of(measure, pose, "joint_offset@l_shoulder:offset=0.01")[1]
        moved, full = ((b.currents - before.currents)[-1, i] for b in (after, offset))
        motor = robot.motors["l_shoulder"]
        gravity = -before.currents[-1, i] * motor.torque_constant * motor.sign
        plays.append((moved / full, np.sign(gravity)))
    assert robot.tree.masses[arm] > 0
    assert {sign for _, sign in plays} == {-1.0, 1.0}
    for play, sign in plays:
        assert play == pytest.approx(sign, abs=0.05)


def test_hysteresis_follows_the_approach(measure: Measure, biped14: Any) -> None:
    robot = biped14.robot
    pose = next(p for p in biped14.plan if p.pose == 39)
    i = joint(robot, "l_shoulder")
    found = {}
    for side in (-1, 1, 0):
        request = SourceRequest(
            robot, seed=1, noise=False, effects=("hysteresis@l_shoulder:half_width=0.01",)
        )
        with sources.open_builtin(request) as source:
            source.move_to(replace(pose, approach={"l_shoulder": side}))
            found[side] = source.read(0.02).currents[-1, i]
    offset = measure("joint_offset@l_shoulder:offset=0.01", poses=[39])[0].currents[-1, i]
    assert found[1] == pytest.approx(offset, rel=1e-9)
    assert found[1] - found[0] == pytest.approx(found[0] - found[-1], rel=0.05)


def test_stiction_shifts_currents_by_its_size_with_the_approach(
    measure: Measure, biped14: Any
) -> None:
    robot = biped14.robot
    before, after = (
        measure(*effects, poses=[20])[-1]
        for effects in ((), ("joint_friction@all:coulomb=3,load_factor=0.1",))
    )
    way = np.array([p.q for p in biped14.plan if p.pose <= 20])
    side = np.sign(way[0])
    for step in np.sign(np.diff(way, axis=0)):
        side = np.where(step == 0.0, side, step)  # what rests keeps its last side
    assert np.any(way[-1] == way[-2])
    motors = [robot.motors[name] for name in robot.tree.joint_names]
    K = np.array([m.torque_constant * m.gear * m.sign for m in motors])
    torque = before.currents[-1] * K
    np.testing.assert_allclose(
        after.currents[-1] * K, torque + side * (3 + 0.1 * np.abs(torque)), atol=1e-9
    )
    for sensor in robot.sensors:
        np.testing.assert_allclose(after.wrenches[sensor], before.wrenches[sensor], atol=1e-9)


def test_stiction_turns_round_on_the_way_back(robot: Any) -> None:
    """Arrived upwards, half undone, gone; a joint that turns back is held the other way."""
    change = parse_change("joint_friction@l_knee:coulomb=3,load_factor=0.1")
    brush, knee = Stiction(robot, [change]), joint(robot, "l_knee")
    one = np.eye(len(robot.tree.joint_names))[knee]
    brush.arrive(np.zeros_like(one), one)
    for way, part in ((0.0, 1.0), (-0.5, 0.5), (-1.0, 0.0), (-5.0, -1.0), (-4.5, -0.5), (9.0, 1.0)):
        brush.step(way * BREAK_AWAY * one)
        np.testing.assert_allclose(brush.beside(-20.0 * one), 5.0 * part * one, atol=1e-12)


def test_a_turned_sensor_keeps_norms_and_turns_by_the_rotation_vector(measure: Measure) -> None:
    before, after = change_of(measure, 20, "ft_mounting@l_foot:ry=0.02,rz=-0.01")
    w, turned = before.wrenches["l_foot"][-1], after.wrenches["l_foot"][-1]
    angle = np.hypot(0.02, 0.01)
    R = rotation_about(np.array([0, 0.02, -0.01]) / angle, angle)
    np.testing.assert_allclose(turned, np.concatenate([R @ w[:3], R @ w[3:]]), atol=1e-9)
    np.testing.assert_allclose(after.wrenches["r_foot"], before.wrenches["r_foot"], atol=1e-9)


def test_a_moved_sensor_feels_the_moment_about_its_new_origin(measure: Measure) -> None:
    before, after = change_of(measure, 20, "ft_position@l_foot:x=0.01,z=0.02")
    w = before.wrenches["l_foot"][-1]
    moved = w[3:] - np.cross([0.01, 0.0, 0.02], w[:3])
    np.testing.assert_allclose(after.wrenches["l_foot"][-1], [*w[:3], *moved], atol=1e-9)


def test_gain_crosstalk_bias_and_mounting_combine_as_the_contract_says(measure: Measure) -> None:
    """w' = R (I + G + E) w + b."""
    before = measure(poses=[20])[0].wrenches["l_foot"][-1]
    after = measure(
        "ft_gain@l_foot:gain_fz=0.03",
        "ft_crosstalk@l_foot:fz_to_ty=0.01",
        "ft_bias@l_foot:fx=2,ty=0.5",
        "ft_mounting@l_foot:rx=0.05",
        poses=[20],
    )[0].wrenches["l_foot"][-1]
    matrix = np.eye(6)
    matrix[2, 2] += 0.03
    matrix[4, 2] += 0.01
    R = np.kron(np.eye(2), rotation_about([1, 0, 0], 0.05))
    np.testing.assert_allclose(after, R @ matrix @ before + [2, 0, 0, 0, 0.5, 0], atol=1e-9)


def test_drift_grows_with_time_and_temperature_offset_with_warmth(measure: Measure) -> None:
    plain = measure(poses=[1, 20])
    for effect in ("ft_drift@l_foot:fz=0.001", "ft_temperature@l_foot:fz=0.5"):
        blocks = measure(effect, poses=[1, 20])
        added = [
            (b.wrenches["l_foot"] - p.wrenches["l_foot"])[-1, 2]
            for b, p in zip(blocks, plain, strict=True)
        ]
        if "drift" in effect:
            expected = [0.001 * b.t[-1] for b in blocks]
        else:
            T = [b.temperatures["l_foot"][-1] for b in blocks]
            expected = [0.0, 0.5 * (T[1] - T[0])]
        np.testing.assert_allclose(added, expected, atol=0.01)
        assert added[1] > 0.5


def test_a_sloping_floor_turns_gravity_in_the_sole(measure: Measure) -> None:
    _, after = change_of(measure, 30, "ground_tilt:roll=0.02,pitch=0.01")
    force = after.wrenches["r_foot"][-1, :3]
    assert force[0] / force[2] == pytest.approx(-np.tan(0.01) / np.cos(0.02), rel=1e-6)
    assert force[1] / force[2] == pytest.approx(np.tan(0.02), rel=1e-6)


def test_a_turned_imu_reads_turned_gravity_and_nothing_else_changes(measure: Measure) -> None:
    before, after = change_of(measure, 20, "imu_mounting:roll=0.02")
    np.testing.assert_allclose(
        after.imu[-1], rotation_about([1, 0, 0], 0.02).T @ before.imu[-1], atol=1e-9
    )
    np.testing.assert_allclose(after.currents, before.currents, atol=1e-12)


def test_a_soft_sole_tilts_the_foot_where_it_is_loaded(measure: Measure) -> None:
    before, after = change_of(measure, 20, "sole_compliance@left:tilt_y=2e-4")
    moment = after.wrenches["l_foot"][-1, 4]
    force = after.wrenches["l_foot"][-1, :3]
    # toes down (a positive pitch) where the load is ahead, which is a negative ty
    assert force[0] / force[2] == pytest.approx(-np.tan(-2e-4 * moment), rel=1e-3)
    assert abs(moment) > 5.0
    np.testing.assert_allclose(
        np.linalg.norm(force), np.linalg.norm(before.wrenches["l_foot"][-1, :3]), rtol=1e-9
    )


def test_a_shim_under_a_foot_closes_the_chain_and_encoders_see_it(
    measure: Measure, robot: Any
) -> None:
    _, after = change_of(measure, 3, "foot_placement@right:z=0.006,roll=0.01")
    at = place_links(robot.tree, after.q[-1])
    T = []
    for foot in (robot.feet["left"], robot.feet["right"]):
        R, p = (a[0] for a in at.link(foot.link))
        T.append((R @ foot.T_link_sole[:3, :3], R @ foot.T_link_sole[:3, 3] + p))
    (R0, p0), (R1, p1) = T
    assert (R0.T @ (p1 - p0))[2] == pytest.approx(0.006, abs=1e-6)
    np.testing.assert_allclose((R0.T @ R1)[1:, 2], [-np.sin(0.01), np.cos(0.01)], atol=1e-3)


def test_pulls_add_their_force_to_the_feet(measure: Measure, robot: Any) -> None:
    before, after = change_of(measure, 20, "cable_pull@torso:force_x=8,force_z=5")
    added = (after.wrenches["l_foot"] - before.wrenches["l_foot"])[-1, :3]
    np.testing.assert_allclose(added, [-8, 0, -5], atol=1e-9)
    touched = measure("external_contact@l_arm:force_z=10,poses=30", poses=[20, 30])
    untouched = measure(poses=[20, 30])
    lighter = [
        sum((u.wrenches[s] - t.wrenches[s])[-1, 2] for s in robot.sensors)
        for t, u in zip(touched, untouched, strict=True)
    ]
    np.testing.assert_allclose(lighter, [0.0, 10.0], atol=1e-9)


def test_a_tether_pulls_by_its_stiffness_from_where_it_was_first(
    measure: Measure, biped14: Any
) -> None:
    blocks = measure("tether@pelvis:force_x=3,k_xx=50", poses=[1, 20])
    plain = measure(poses=[1, 20])
    pull = [
        -sum((b.wrenches[s] - p.wrenches[s])[-1, 0] for s in b.wrenches)
        for b, p in zip(blocks, plain, strict=True)
    ]
    from comcal_sims.footing import base_in_world

    x = [base_in_world(biped14.robot, p)[0, 3] for p in biped14.plan if p.pose in (1, 20)]
    np.testing.assert_allclose(pull, [3.0, 3.0 - 50 * (x[1] - x[0])], atol=1e-6)


def test_motor_faults_scale_and_shift_currents(measure: Measure, robot: Any) -> None:
    before, after = change_of(measure, 20, "torque_constant@l_knee:relative=0.25")
    i = joint(robot, "l_knee")
    np.testing.assert_allclose(after.currents[:, i], before.currents[:, i] / 1.25)
    before, after = change_of(measure, 20, "current_offset@all:offset=0.3")
    np.testing.assert_allclose(after.currents, before.currents + 0.3)


def test_masses_and_lengths_change_the_robot(measure: Measure, robot: Any) -> None:
    before, after = change_of(measure, 20, "link_mass@l_arm:mass=0.5")
    added = (after.wrenches["l_foot"] - before.wrenches["l_foot"])[-1, 2]
    assert added == pytest.approx(0.5 * G, rel=1e-9)
    before, after = change_of(measure, 20, "sole_mass@r_foot:mass=0.2")
    lifted = np.linalg.norm(after.wrenches["r_foot"][-1, :3])
    assert lifted == pytest.approx((0.3 + 0.2) * G, rel=1e-9)
    before, after = change_of(measure, 20, "link_com@torso:com_x=0.01")
    assert np.abs(after.wrenches["l_foot"][-1, :3] - before.wrenches["l_foot"][-1, :3]).max() < 1e-9
    # 20 kg, less a yoke, 10 mm further on, seen about the ankle
    moved = np.linalg.norm((after.wrenches["l_foot"] - before.wrenches["l_foot"])[-1, 3:])
    assert 0.7 * 20 * G * 0.01 < moved <= 20 * G * 0.01
    with pytest.raises(UsageError, match="no mass left"):
        measure("link_mass@l_arm:mass=-9", poses=[20])


def test_plain_statics_refuse_what_moves_and_name_those_that_can(measure: Measure) -> None:
    with pytest.raises(UsageError, match=r"not_settled.*--source pybullet or mujoco"):
        measure("not_settled:time=1", poses=[1])
    with pytest.raises(UsageError, match="no simulated robot can"):
        measure("inertia:factor=1", poses=[1])
