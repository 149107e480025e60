# SPDX-License-Identifier: Apache-2.0
"""What a body obeys is written down for the body, in the frame of the link that stands for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.bounds import physical_bounds
from comcal.identify.unknowns import unknowns_of
from comcal.robot.tree import Box, JointType, Shape


def box(low, high, shape=Shape.BOX):
    T = np.eye(4)
    T[:3, 3] = 0.5 * (np.array(low) + np.array(high))
    return Box(T, np.array(high) - np.array(low, np.float64), shape)


INSIDE = box((-0.1, -0.1, 0.0), (0.1, 0.1, 0.3))


def slack(unknowns, theta):
    """Room below every bound [kg, kg m], by its words."""
    return {b.words: b.limit - b.row @ theta for b in physical_bounds(unknowns).bounds}


@pytest.mark.parametrize("free_masses", [False, True])
def test_a_com_inside_its_box_obeys_and_one_at_a_face_is_at_its_bound(chain, free_masses):
    robot = chain(boxes=[(INSIDE,), ()])
    unknowns = unknowns_of(robot, free_masses=free_masses)
    assert min(slack(unknowns, unknowns.cad).values()) > 0.0
    theta = unknowns.cad.copy()
    theta[unknowns.column(0)] = 4.0 * 0.1
    room = slack(unknowns, theta)
    at = [words for words, left in room.items() if abs(left) < 1e-12]
    assert at == ["link0 CoM x at its upper bound 0.1 m of the box"]
    theta[unknowns.column(0)] += 4.0 * 0.001
    assert slack(unknowns, theta)[at[0]] == pytest.approx(-0.004)
    if free_masses:  # a heavier link has its CoM nearer to the origin
        theta[0] *= 1.02
        assert slack(unknowns, theta)[at[0]] > 0.0


def test_links_fixed_to_one_another_share_one_outline(chain):
    # link1 sits a quarter of a metre above link0; its own box ends 0.1 m above its frame.
    top = box((-0.3, -0.05, 0.0), (0.05, 0.05, 0.2))
    robot = chain(boxes=[(INSIDE,), (top,)], kind=JointType.FIXED)
    unknowns = unknowns_of(robot)
    assert unknowns.links == (0,)
    room = slack(unknowns, unknowns.cad)
    faces = {words.split(" at its ")[1] for words in room if "CoM" in words}
    assert {"upper bound 0.45 m of the box", "lower bound -0.3 m of the box"} <= faces
    assert all("link0 with link1: CoM" in words for words in room if "CoM" in words)
    com = (4.0 * robot.tree.coms[0] + 2.0 * (robot.tree.coms[1] + [0, 0, 0.25])) / 6.0
    left = next(v for words, v in room.items() if "CoM z at its upper" in words)
    assert left == pytest.approx(6.0 * (0.45 - com[2]))


def test_a_member_that_is_fixed_on_its_side_is_turned_into_the_bodys_frame(chain):
    long = box((0.0, -0.05, 0.0), (0.1, 0.05, 0.8))
    robot = chain(boxes=[(INSIDE,), (long,)], kind=JointType.FIXED)
    T = robot.tree.joints[0].T_parent_joint.copy()
    T[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # its z is the body's x
    joint = replace(robot.tree.joints[0], T_parent_joint=T)
    robot = replace(robot, tree=replace(robot.tree, joints=(joint,)))
    room = slack(unknowns_of(robot), unknowns_of(robot).cad)
    x, y, z = robot.tree.coms[1]
    com = (4.0 * robot.tree.coms[0] + 2.0 * np.array([z, y, 0.25 - x])) / 6.0
    upper = next(v for words, v in room.items() if "x at its upper bound 0.8 m" in words)
    lower = next(v for words, v in room.items() if "z at its lower bound 0 m" in words)
    assert (upper, lower) == (pytest.approx(6 * (0.8 - com[0])), pytest.approx(6 * com[2]))


def test_a_member_without_geometry_counts_with_its_com(chain):
    robot = chain(boxes=[(INSIDE,), ()], kind=JointType.FIXED)
    words = [b.words for b in physical_bounds(unknowns_of(robot)).bounds]
    assert "link0 with link1: CoM z at its upper bound 0.37 m of the box" in words


def test_a_turned_box_is_bounded_by_its_corners(chain):
    T = INSIDE.T_link_box.copy()
    c = np.sqrt(0.5)
    T[:2, :2] = [[c, -c], [c, c]]
    robot = chain(boxes=[(replace(INSIDE, T_link_box=T),), ()])
    words = [b.words for b in physical_bounds(unknowns_of(robot)).bounds]
    assert "link0 CoM x at its upper bound 0.1414 m of the box" in words


def test_a_link_without_boxes_and_one_outside_its_boxes_are_not_bounded(chain):
    sole = box((-0.1, -0.1, -0.02), (0.1, 0.1, 0.0))  # where it touches the ground
    found = physical_bounds(unknowns_of(chain(boxes=[(), (sole,)])))
    reasons = dict(found.without)
    assert "meshes are not read" in reasons["link0"]
    assert "120 mm outside" in reasons["link1"]
    assert not any("CoM" in bound.words for bound in found.bounds)


def test_masses_that_are_free_stay_positive_and_given_ones_are_held_to_it(chain):
    robot = chain(masses=(4.0, 2.0))
    unknowns = unknowns_of(robot, free_masses=True)
    theta = unknowns.cad.copy()
    theta[1] = 0.0
    room = slack(unknowns, theta)
    assert [w for w, left in room.items() if left < 0] == ["link1 mass at its lower bound 0.02 kg"]
    given = unknowns_of(chain(masses=(4.0, -2.0)))
    room = slack(given, given.cad)
    assert [w for w, left in room.items() if left < 0] == [
        "link1 mass, given as -2 kg, has to be positive"
    ]
