# SPDX-License-Identifier: Apache-2.0
"""Where a robot goes to arrive from a certain side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.both_sides import DEFAULT_VIA, both_sides
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.via_poses import LEAST_PART, via_poses
from comcal_sims.footing import base_in_world
from comcal_sims.robots.biped14 import generate


@pytest.fixture(scope="module")
def robot_yaml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generate(tmp_path_factory.mktemp("biped14"))


@pytest.fixture(scope="module")
def robot(robot_yaml: Path) -> Robot:
    return load_robot(robot_yaml)


@pytest.fixture(scope="module")
def plan(robot: Robot, robot_yaml: Path) -> tuple[PlannedPose, ...]:
    poses = read_plan(robot_yaml.with_name("plan.csv"), robot.tree.joint_names)
    return both_sides([poses[i] for i in (1, 4, 20, 21, 30, 39)], robot.tree.joint_names)


def sides_of(robot: Robot, pose: PlannedPose) -> np.ndarray:
    return np.array([pose.approach.get(name, 0) for name in robot.tree.joint_names])


def test_every_second_visit_comes_from_beyond(robot: Robot, plan: tuple[PlannedPose, ...]) -> None:
    vias = via_poses(robot, plan)
    for pose in plan[1::2]:
        via = vias.poses[pose.pose]
        way = (pose.q - via.q) * sides_of(robot, pose)
        names = robot.tree.joint_names
        lacking = vias.without_room.get(pose.pose, ())
        for name, side, w in zip(names, sides_of(robot, pose), way, strict=True):
            if side and name not in lacking:
                assert w >= LEAST_PART * DEFAULT_VIA
    lacks = sum(len(names) for names in vias.without_room.values())
    asked = sum(len(pose.approach) for pose in plan)
    assert lacks < 0.1 * asked


def test_vias_are_within_limits_on_the_floor_and_balanced(
    robot: Robot, plan: tuple[PlannedPose, ...]
) -> None:
    tree = robot.tree
    joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
    vias = via_poses(robot, plan)
    assert vias.poses
    for pose in vias.poses.values():
        for joint, q in zip(joints, pose.q, strict=True):
            assert joint.lower <= q <= joint.upper
        base_in_world(robot, pose)  # refuses soles that do not lie in one plane


def test_a_hanging_robot_goes_exactly_as_far_as_asked(robot: Robot) -> None:
    names = robot.tree.joint_names
    pose = PlannedPose(7, np.zeros(len(names)), NONE, approach={"waist_roll": 1, "l_shoulder": -1})
    via = via_poses(robot, (pose,), 0.1).poses[7]
    expected = np.zeros(len(names))
    expected[names.index("waist_roll")] = -0.1
    expected[names.index("l_shoulder")] = 0.1
    np.testing.assert_allclose(via.q, expected)


def test_a_joint_at_its_limit_has_no_room_and_is_named(robot: Robot) -> None:
    tree = robot.tree
    names = tree.joint_names
    q = np.zeros(len(names))
    k = names.index("l_shoulder")
    q[k] = tree.joints[tree.joint_index["l_shoulder"]].upper
    pose = PlannedPose(7, q, NONE, approach={"l_shoulder": -1, "waist_roll": 1})
    vias = via_poses(robot, (pose,))
    assert vias.without_room == {7: ("l_shoulder",)}
    assert vias.poses[7].q[k] == q[k]
    alone = via_poses(robot, (replace(pose, approach={"l_shoulder": -1}),))
    assert alone.poses == {}


def test_who_comes_from_far_enough_anyway_needs_no_via(robot: Robot) -> None:
    names = robot.tree.joint_names
    here = PlannedPose(1, np.zeros(len(names)), NONE)
    q = here.q.copy()
    q[0] = 0.2
    there = PlannedPose(2, q, NONE, approach={names[0]: 1})
    assert via_poses(robot, (here, there), 0.1).poses == {}
    assert list(via_poses(robot, (here, there), 0.3).poses) == [2]
    assert list(via_poses(robot, (here, replace(there, approach={names[0]: -1}))).poses) == [2]
