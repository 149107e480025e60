# SPDX-License-Identifier: Apache-2.0
"""Twins of joints on the other side."""

from __future__ import annotations

from dataclasses import replace

import pytest

from comcal.robot.mirror import mirrored_joints
from comcal.robot.model import Robot
from comcal.robot.tree import Joint


def renamed(robot: Robot, names: dict[str, str]) -> Robot:
    def new(joint: Joint) -> Joint:
        return replace(joint, name=names.get(joint.name, joint.name))

    tree = replace(robot.tree, joints=tuple(map(new, robot.tree.joints)))
    return Robot(robot.name, tree)


def test_joints_that_differ_in_the_side_alone_are_twins(biped14) -> None:
    twins = dict(mirrored_joints(biped14.robot))
    assert twins["l_knee"] == "r_knee"
    assert twins["l_ankle_roll"] == "r_ankle_roll"
    assert len(twins) == 6
    assert not {"waist_roll", "waist_pitch"} & {*twins, *twins.values()}


@pytest.mark.parametrize(
    ("left", "right"),
    [("LeftKnee", "RightKnee"), ("left_knee_2", "right_knee_2"), ("LKnee", "RKnee")],
)
def test_sides_are_read_in_other_spellings(biped14, left: str, right: str) -> None:
    robot = renamed(biped14.robot, {"l_knee": left, "r_knee": right})
    assert dict(mirrored_joints(robot))[left] == right


def test_joints_of_one_side_alone_have_no_twin(biped14) -> None:
    robot = renamed(biped14.robot, {"r_knee": "r_other"})
    assert "l_knee" not in dict(mirrored_joints(robot))
