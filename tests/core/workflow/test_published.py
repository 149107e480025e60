# SPDX-License-Identifier: Apache-2.0
"""The paper's formulas on whole sessions: which poses are taken, what is refused and why.

The sessions come from plain statics without any sensor error, so the corrected formulas must give
the URDF's links exactly. Physics itself is tested in tests/golden and tests/sims.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.measure.plan import PlannedPose
from comcal.measure.table import PoseTable
from comcal.robot.description import load_robot
from comcal.statics.published_faults import AS_PUBLISHED, CORRECTED, Fault
from comcal.workflow.published import NotComparable, PublishedComparison, published_comparison
from comcal_sims.builtin_world import static_state
from comcal_sims.robots.table1 import (
    Table1Parameters,
    generate,
    lateral_pose,
    planar_pose,
    table1_plan,
)

TEN = np.deg2rad(10)
PAPER = ((0.0, 0.0), (TEN, TEN), (0.0, TEN), (TEN, 2 * TEN))
ASKEW = {"r_a": 0.004, "r_b": 0.010, "r_c": -0.020, "waist_r": 0.015, "waist_l": 0.080}


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Return the Table 1 robot as it is, and with links whose CoMs lie beside their axes."""
    folder = tmp_path_factory.mktemp("robots")
    kinds = {"plain": {}, "askew": ASKEW, "roll": {"roll_joints": True}}
    return {
        name: (load_robot(generate(folder / name, **kind)), Table1Parameters(**kind))
        for name, kind in kinds.items()
    }


def planned(robot, parameters, pitches, **more):
    poses = []
    for k, (shin, thigh) in enumerate(pitches):
        q = planar_pose(parameters, shin, thigh)
        poses.append(PlannedPose(k + 1, np.array([q[j] for j in robot.tree.joint_names]), **more))
    return poses


def recorded(robot, poses):
    """Return the pose table of a world without sensor errors."""
    states = [static_state(robot, pose) for pose in poses]
    n, n_joints = len(poses), len(robot.tree.joint_names)
    zero, unknown, point = (
        np.zeros((n, n_joints)),
        np.full((n, n_joints), np.nan),
        np.full((n, 3), np.nan),
    )
    return PoseTable(
        pose=tuple(pose.pose for pose in poses),
        support=tuple(pose.support for pose in poses),
        q=np.array([state.q for state in states]),
        q_cov=zero,
        wrench={s: np.array([state.wrenches[s] for state in states]) for s in robot.sensors},
        wrench_cov={s: np.tile(np.eye(6) * 1e-4, (n, 1, 1)) for s in robot.sensors},
        torque=np.array([state.torques for state in states]),
        torque_var=zero,
        current=unknown,
        current_var=unknown,
        com=point,
        com_var=point,
        imu=point,
        configuration=("",) * n,
        tilt=np.full(n, np.nan),
    )


def session(robots, name, pitches=PAPER, **more):
    robot, parameters = robots[name]
    return robot, recorded(robot, planned(robot, parameters, pitches, **more))


def links_mm(comparison, faults, factor=1.0):
    assert isinstance(comparison, PublishedComparison), comparison
    [variant] = [v for v in comparison.variants if (v.faults, v.factor) == (faults, factor)]
    return variant.result.links.as_array() * 1e3 if variant.result else variant.reason


def test_without_faults_the_urdf_comes_back(robots):
    comparison = published_comparison(*session(robots, "plain"))
    assert links_mm(comparison, CORRECTED) == pytest.approx((0, 200, 0, 322.0859), abs=1e-4)
    assert comparison.poses == (1, 2, 3, 4)
    assert comparison.notes == ()


@pytest.mark.parametrize("name", ["plain", "askew", "roll"])
@pytest.mark.parametrize("slope", [0.0, 0.04])
def test_without_faults_every_robot_and_slope_agrees_with_its_urdf(robots, name, slope):
    comparison = published_comparison(*session(robots, name, floor_pitch=slope))
    found = links_mm(comparison, CORRECTED)
    assert found == pytest.approx(comparison.nominal.as_array() * 1e3, abs=1e-6)


def test_nominal_links_are_those_of_table_1(robots):
    """The sensor is above the sole plates: 0.1 kg on each side are not carried."""
    comparison = published_comparison(*session(robots, "askew"))
    nominal = comparison.nominal.as_array() * 1e3
    r_c, l_c = (2 * 1.16 * -20 + 0.94 * 15) / 3.26, (2 * 1.16 * 250 + 0.94 * 580) / 3.26
    assert nominal == pytest.approx((10, 200, r_c, l_c), abs=1e-9)
    chain = comparison.chain
    assert chain.foot.m_u == pytest.approx(13.24)
    assert (chain.m_b, chain.m_c, chain.waist_mass) == pytest.approx((1.90, 3.26, 0.94))
    assert (chain.L_b, chain.foot.U) == pytest.approx((0.400, 0.080))


def test_each_fault_alone_spoils_the_links(robots):
    comparison = published_comparison(*session(robots, "askew"))
    nominal = comparison.nominal.as_array() * 1e3
    for fault in Fault:
        found = links_mm(comparison, fault)
        if fault is Fault.TOO_FEW_POSES:
            assert "3 equations for 4 unknowns" in found
        else:
            assert np.max(np.abs(found - nominal)) > 10.0, fault


def test_all_faults_together_are_shown_with_both_signs_of_the_torques(robots):
    comparison = published_comparison(*session(robots, "plain"))
    plus, minus = (links_mm(comparison, AS_PUBLISHED, k) for k in (1.0, -1.0))
    assert np.max(np.abs(plus - minus)) > 1000.0


def test_internal_torques_are_those_of_hand_statics(robots):
    """Knees and ankles of pose b hold 6.45 N m and 3.26 kg, 5.16 kg; the hips nothing."""
    comparison = published_comparison(*session(robots, "plain"))
    s = np.sin(TEN)
    x_c = 0.3220858896
    knees = 3.26 * 9.81 * x_c * s
    ankles = 9.81 * s * (1.90 * 0.200 + 3.26 * (0.400 + x_c))
    b = comparison.inputs[1]
    assert b.internal * (18.4 * 9.81) == pytest.approx(knees + ankles, abs=1e-7)


def test_currents_serve_where_torques_are_not_measured(robots):
    robot, table = session(robots, "askew")
    constants = [
        m.torque_constant * m.gear * m.sign
        for m in (robot.motors[name] for name in robot.tree.joint_names)
    ]
    by_current = replace(
        table, current=table.torque / constants, torque=np.full_like(table.torque, np.nan)
    )
    for k in (1.0, -1.0):
        assert links_mm(published_comparison(robot, by_current), AS_PUBLISHED, k) == pytest.approx(
            links_mm(published_comparison(robot, table), AS_PUBLISHED, k), rel=1e-6
        )


def test_without_torques_only_the_internal_torque_term_is_missing(robots):
    robot, table = session(robots, "plain")
    comparison = published_comparison(
        robot, replace(table, torque=np.full_like(table.torque, np.nan))
    )
    assert "torque" in links_mm(comparison, Fault.INTERNAL_TORQUES)
    assert links_mm(comparison, CORRECTED) == pytest.approx((0, 200, 0, 322.0859), abs=1e-4)


def test_shipped_plan_serves_though_its_shins_are_not_upright(robots):
    robot, parameters = robots["askew"]
    comparison = published_comparison(robot, recorded(robot, table1_plan(parameters)))
    assert links_mm(comparison, CORRECTED) == pytest.approx(
        comparison.nominal.as_array() * 1e3, abs=1e-6
    )
    [note] = comparison.notes
    assert "not upright" in note


def test_the_poses_of_the_paper_are_preferred(robots):
    """Upright a and c, and the largest tilts, whatever the order of the session."""
    pitches = (
        (0.2, 0.5), (0.05, 0.05), (0.3, 0.3), (0.0, 0.3), (0.15, 0.15), (0.0, 0.0), (-0.2, 0.1),
        (-0.1, 0.2),
    )  # fmt: skip
    comparison = published_comparison(*session(robots, "plain", pitches))
    assert comparison.poses == (6, 3, 4, 1)


def test_three_poses_give_the_printed_numbers_and_nothing_else(robots):
    comparison = published_comparison(*session(robots, "plain", PAPER[:3]))
    assert comparison.poses == (1, 2, 3)
    assert comparison.rank == 3
    assert "is not determined" in links_mm(comparison, CORRECTED)
    full = published_comparison(*session(robots, "plain"))
    assert links_mm(comparison, AS_PUBLISHED) == pytest.approx(links_mm(full, AS_PUBLISHED))
    assert any("no tilted twin" in note for note in comparison.notes)


@pytest.mark.parametrize(
    ("pitches", "missing"),
    [
        (((0.0, 0.2), (0.2, 0.4)), "straight legs (the paper's a)"),
        (((0.0, 0.0), (0.0, 0.2)), "(the paper's b)"),
        (((0.0, 0.0), (0.2, 0.2)), "(the paper's c)"),
    ],
)
def test_a_missing_pose_is_named(robots, pitches, missing):
    answer = published_comparison(*session(robots, "plain", pitches))
    assert isinstance(answer, NotComparable)
    assert missing in answer.reason


def test_a_session_on_one_foot_is_answered_in_words(robots):
    robot, table = session(robots, "plain")
    answer = published_comparison(robot, replace(table, support=("left",) * len(table)))
    assert isinstance(answer, NotComparable)
    assert "two feet" in answer.reason


def test_a_bent_hip_does_not_pass_for_a_bent_knee(robots):
    """In c the trunk must go with the thighs, or thigh and trunk are two links."""
    robot, parameters = robots["plain"]
    q = planar_pose(parameters, 0.0, TEN, waist=0.0)
    upright_trunk = PlannedPose(9, np.array([q[j] for j in robot.tree.joint_names]))
    table = recorded(robot, [*planned(robot, parameters, PAPER[:2]), upright_trunk])
    answer = published_comparison(robot, table)
    assert isinstance(answer, NotComparable)
    assert "bent as one link" in answer.reason


def test_a_robot_without_foot_sensors_is_answered_in_words(robots):
    robot, table = session(robots, "plain")
    feet = {name: replace(foot, sensor=None) for name, foot in robot.feet.items()}
    answer = published_comparison(replace(robot, feet=feet), table)
    assert isinstance(answer, NotComparable)


def test_an_absent_wrench_is_answered_in_words(robots):
    robot, table = session(robots, "plain")
    left_only = {name: w for name, w in table.wrench.items() if name.startswith("l")}
    answer = published_comparison(robot, replace(table, wrench=left_only))
    assert isinstance(answer, NotComparable)
    assert "no wrench of sensor" in answer.reason


def test_a_pose_that_carries_nothing_is_passed_over(robots):
    robot, table = session(robots, "plain", (*PAPER, (0.5, 0.5)))
    wrench = {name: w.copy() for name, w in table.wrench.items()}
    for w in wrench.values():
        w[4] = 0.0
    comparison = published_comparison(robot, replace(table, wrench=wrench))
    assert comparison.poses == (1, 2, 3, 4)


def test_lateral_poses_are_not_taken_for_planar_ones(robots):
    """Nor does a sway in the first pose hide the pitch joints of the others."""
    robot, parameters = robots["roll"]
    sway = lateral_pose(parameters, np.deg2rad(4))
    first = PlannedPose(9, np.array([sway[j] for j in robot.tree.joint_names]))
    table = recorded(robot, [first, *planned(robot, parameters, PAPER)])
    assert published_comparison(robot, table).poses == (1, 2, 3, 4)


def test_a_leg_without_knee_is_answered_in_words(robots):
    robot, table = session(robots, "plain")
    feet = {name: replace(f, ankle=f"{name[0]}_knee") for name, f in robot.feet.items()}
    answer = published_comparison(replace(robot, feet=feet), table)
    assert isinstance(answer, NotComparable)
    assert "ankle, knee and hip" in answer.reason
