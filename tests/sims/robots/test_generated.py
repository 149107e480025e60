# SPDX-License-Identifier: Apache-2.0
"""What holds for every generated robot and every pose of its plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.measure.plan import DOUBLE, NONE
from comcal.robot.urdf import read_urdf
from comcal_sims.robots import biped14 as biped14_robot
from comcal_sims.robots import table1 as table1_robot
from comcal_sims.robots.balance import support_margin
from comcal_sims.robots.biped14 import Biped14Parameters, biped14_spec
from comcal_sims.robots.model import Lump
from comcal_sims.robots.table1 import Table1Parameters, table1_spec
from comcal_sims.robots.urdf import urdf_text

MARGIN = 0.015
CLEARANCE = 0.020


@pytest.mark.parametrize(
    "spec",
    [
        table1_spec(Table1Parameters(r_b=0.01, l_c=1 / 3)),
        table1_spec(Table1Parameters(roll_joints=True)),
        biped14_spec(Biped14Parameters()),
    ],
    ids=["table1", "table1_roll", "biped14"],
)
def test_reading_the_urdf_gives_the_tree_that_was_written(spec, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(urdf_text(spec))
    read, written = read_urdf(path), spec.tree()
    assert read.joint_names == written.joint_names == spec.joint_names
    assert [link.name for link in read.links] == [link.name for link in written.links]
    assert read.masses == pytest.approx(written.masses, abs=1e-14)
    assert read.coms == pytest.approx(written.coms, abs=1e-14)
    for a, b in zip(read.links, written.links, strict=True):
        assert a.inertia == pytest.approx(b.inertia, rel=1e-13)
        assert len(a.boxes) == len(b.boxes)
        for box_a, box_b in zip(a.boxes, b.boxes, strict=True):
            assert box_a.T_link_box == pytest.approx(box_b.T_link_box, abs=1e-14)
            assert box_a.size == pytest.approx(box_b.size, abs=1e-14)
    for a, b in zip(read.joints, written.joints, strict=True):
        assert (a.name, a.kind, a.parent, a.child) == (b.name, b.kind, b.parent, b.child)
        assert (a.lower, a.upper, a.effort) == pytest.approx((b.lower, b.upper, b.effort))
        assert a.T_parent_joint == pytest.approx(b.T_parent_joint, abs=1e-14)
        assert a.axis == pytest.approx(b.axis)


@pytest.mark.parametrize("package", [table1_robot, biped14_robot], ids=["table1", "biped14"])
def test_generating_twice_gives_the_same_files(package, tmp_path):
    one, two = (package.generate(tmp_path / name).parent for name in "ab")
    for path in one.iterdir():
        assert path.read_bytes() == (two / path.name).read_bytes()


def test_every_link_has_a_physical_inertia(generated):
    for link in generated.robot.tree.links:
        assert link.has_inertial
        assert link.mass > 0.0
        moments = np.diag(link.inertia)
        assert np.array_equal(link.inertia, np.diag(moments))
        assert moments.min() > 0.0
        assert moments.sum() > 2 * moments.max()


def test_only_the_bumpers_touch_and_their_lowest_points_are_the_corners(generated):
    robot = generated.robot
    for link in robot.tree.links:
        foot = next((foot for foot in robot.feet.values() if foot.link == link.name), None)
        assert len(link.boxes) == (0 if foot is None else 4)
        if foot is not None:
            centres = np.array([box.T_link_box[:3, 3] for box in link.boxes])
            lowest = centres - [0.0, 0.0, link.boxes[0].size[2] / 2]
            in_sole = lowest - foot.T_link_sole[:3, 3]
            assert in_sole == pytest.approx(np.column_stack([foot.sole, np.zeros(4)]), abs=1e-12)


def test_every_pose_respects_the_joint_limits(generated):
    tree = generated.robot.tree
    joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    for pose in generated.plan:
        assert np.all((lower <= pose.q) & (pose.q <= upper)), pose.pose


def test_standing_soles_lie_flat_in_one_plane(generated):
    for pose in generated.plan:
        corners = generated.corners(pose)
        for name in generated.standing(pose):
            assert np.abs(corners[name][:, 2]).max() < 1e-9, pose.pose
        if pose.support == DOUBLE:
            (left, _), (right, _) = generated.soles(pose).values()
            assert np.allclose(left, right, atol=1e-9), f"pose {pose.pose}: feet are not parallel"


def test_every_standing_pose_is_balanced_with_margin(generated):
    for pose in generated.plan:
        if pose.support == NONE:
            continue
        corners = generated.corners(pose)
        contacts = np.vstack([corners[name][:, :2] for name in generated.standing(pose)])
        assert support_margin(generated.com(pose)[:2], contacts) >= MARGIN, pose.pose


def test_lifted_feet_clear_the_floor_and_the_standing_foot(biped14):
    for pose in biped14.plan:
        if pose.support in (DOUBLE, NONE):
            continue
        corners = biped14.corners(pose)
        (lifted,) = set(corners) - {pose.support}
        outwards = 1.0 if lifted == "left" else -1.0
        half_width = np.abs(corners[pose.support][:, 1]).max()
        assert corners[lifted][:, 2].min() >= CLEARANCE, pose.pose
        assert (outwards * corners[lifted][:, 1]).min() >= half_width + CLEARANCE, pose.pose


def test_plans_have_the_promised_poses(table1, biped14):
    assert 20 <= len(table1.plan) <= 30
    supports = [pose.support for pose in biped14.plan]
    counts = {support: supports.count(support) for support in set(supports)}
    assert counts == {"double": 17, "left": 10, "right": 10, "none": 4}


def test_a_body_cannot_lose_more_than_it_weighs():
    with pytest.raises(ValueError, match="leave"):
        Lump(1.0, (0, 0, 0)).without(Lump(1.5, (0, 0, 0)))


def test_the_margin_is_negative_outside():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]], dtype=float)
    assert support_margin([0.5, 0.3], square) == pytest.approx(0.3)
    assert support_margin([1.2, 0.5], square) == pytest.approx(-0.2)


def test_biped14_is_the_promised_robot(biped14):
    tree = biped14.robot.tree
    assert tree.total_mass == pytest.approx(64.0, abs=1e-12)
    assert len(tree.joint_names) == 14
    massive = [link.name for link in tree.links if link.mass > 1.0]
    assert len(massive) == 10
    assert biped14.robot.imu_link == "pelvis"
    light = {link.mass for link in tree.links if link.name.endswith("_yoke")}
    assert light == {0.001}


def test_a_stance_that_cannot_close_is_refused():
    parameters = replace(Biped14Parameters(), shin_length=0.30)
    with pytest.raises(UsageError, match="does not reach"):
        biped14_robot.double_pose(parameters, z=0.80)
