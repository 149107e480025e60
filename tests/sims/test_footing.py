# SPDX-License-Identifier: Apache-2.0
"""The base goes where the soles need it; impossible stances are refused with the reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.measure.plan import DOUBLE, NONE
from comcal.robot.frames import apply
from comcal_sims.footing import BUMPER_RADIUS, base_in_world, bumper_centres, standing_feet
from comcal_sims.rotations import floor_rotation


def test_standing_soles_touch_the_sloping_floor_at_every_corner(generated: Any) -> None:
    for planned in generated.plan:
        if planned.support == NONE:
            continue
        pose = replace(planned, floor_roll=0.05, floor_pitch=-0.08)
        T = base_in_world(generated.robot, pose)
        normal = floor_rotation(0.05, -0.08)[:, 2]
        for name in generated.standing(pose):
            R, p = generated.soles(pose)[name]
            flat = np.column_stack([generated.robot.feet[name].sole, np.zeros(4)])
            corners = apply(T[:3, :3], apply(R, flat) + p) + T[:3, 3]
            assert np.abs(corners @ normal).max() < 1e-9


def test_lowest_point_of_each_bumper_is_a_corner(generated: Any) -> None:
    for foot in generated.robot.feet.values():
        down = -BUMPER_RADIUS * foot.T_link_sole[:3, 2]
        in_sole = bumper_centres(foot) + down - foot.T_link_sole[:3, 3]
        corners = np.column_stack([foot.sole, np.zeros(4)])
        np.testing.assert_allclose(in_sole @ foot.T_link_sole[:3, :3], corners, atol=1e-12)


def test_hanging_robot_is_level_and_stands_on_nothing(biped14: Any) -> None:
    pose = replace(biped14.plan[0], support=NONE)
    np.testing.assert_array_equal(base_in_world(biped14.robot, pose)[:3, :3], np.eye(3))
    assert standing_feet(biped14.robot, NONE) == ()


def test_open_chain_is_refused_with_the_gap(table1: Any) -> None:
    pose = table1.plan[0]
    q = pose.q.copy()
    q[table1.robot.tree.joint_names.index("l_knee")] += 0.3
    with pytest.raises(UsageError, match=r"do not lie in one plane.*deg.*mm"):
        base_in_world(table1.robot, replace(pose, q=q))


def test_swing_foot_on_the_floor_is_refused(table1: Any) -> None:
    pose = next(p for p in table1.plan if p.support == DOUBLE)
    with pytest.raises(UsageError, match=r"foot 'right' reaches the floor.*clearance"):
        base_in_world(table1.robot, replace(pose, support="left"))


def test_unknown_support_names_those_that_exist(table1: Any) -> None:
    with pytest.raises(UsageError, match="double, none, left, right"):
        base_in_world(table1.robot, replace(table1.plan[0], support="middle"))


def test_sole_that_is_not_known_is_refused(table1: Any) -> None:
    feet = {name: replace(foot, sole=None) for name, foot in table1.robot.feet.items()}
    robot = replace(table1.robot, feet=feet)
    with pytest.raises(UsageError, match=r"feet\.left\.sole"):
        base_in_world(robot, table1.plan[0])
