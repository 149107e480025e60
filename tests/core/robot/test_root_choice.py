# SPDX-License-Identifier: Apache-2.0
"""One robot, described from its pelvis and from its left sole: physics must not notice."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links

ROOTED_AT_SOLE = """<robot name="small">
  <link name="l_sole"><inertial><origin xyz="0.02 0 -0.02"/><mass value="0.3"/></inertial></link>
  <link name="l_ankle_body"><inertial><origin xyz="0 0 0.05"/><mass value="0.5"/></inertial></link>
  <link name="l_shin"><inertial><origin xyz="0 0 0.2"/><mass value="2"/></inertial></link>
  <link name="pelvis"><inertial><origin xyz="0 -0.1 0.1"/><mass value="10"/></inertial></link>
  <link name="r_shin"><inertial><origin xyz="0 0 -0.2"/><mass value="2"/></inertial></link>
  <link name="r_ankle_body"><inertial><origin xyz="0 0 0"/><mass value="0.5"/></inertial></link>
  <link name="r_sole"><inertial><origin xyz="0.02 0 -0.02"/><mass value="0.3"/></inertial></link>
  <joint name="l_foot_ft" type="fixed"><parent link="l_sole"/><child link="l_ankle_body"/></joint>
  <joint name="l_ankle" type="continuous"><parent link="l_ankle_body"/><child link="l_shin"/>
    <origin xyz="0 0 0.05"/><axis xyz="0 -1 0"/></joint>
  <joint name="l_hip" type="continuous"><parent link="l_shin"/><child link="pelvis"/>
    <origin xyz="0 0 0.4"/><axis xyz="1 0 0"/></joint>
  <joint name="r_hip" type="continuous"><parent link="pelvis"/><child link="r_shin"/>
    <origin xyz="0 -0.2 0"/><axis xyz="1 0 0"/></joint>
  <joint name="r_ankle" type="continuous"><parent link="r_shin"/><child link="r_ankle_body"/>
    <origin xyz="0 0 -0.4"/><axis xyz="0 -1 0"/></joint>
  <joint name="r_foot_ft" type="fixed"><parent link="r_ankle_body"/><child link="r_sole"/>
    <origin xyz="0 0 -0.05"/></joint>
</robot>"""


@pytest.fixture
def both_roots(biped, write):
    at_pelvis = load_robot(biped)
    write("small.urdf", ROOTED_AT_SOLE)
    return at_pelvis, load_robot(biped)


def reordered(robot, q: dict[str, float]) -> np.ndarray:
    return np.array([[q[name] for name in robot.tree.joint_names]])


def test_com_is_unchanged_by_root_choice(both_roots):
    at_pelvis, at_sole = both_roots
    q = {"l_hip": 0.3, "l_ankle": -0.4, "r_hip": 0.2, "r_ankle": 0.7}
    placed = place_links(at_pelvis.tree, reordered(at_pelvis, q))
    # Parent and child of the left leg's joints change places, so their positions change sign.
    reversed_q = q | {"l_hip": -q["l_hip"], "l_ankle": -q["l_ankle"]}
    com_in_sole = place_links(at_sole.tree, reordered(at_sole, reversed_q)).total_com()[0]
    R, p = placed.link("l_sole")
    np.testing.assert_allclose(R[0].T @ (placed.total_com()[0] - p[0]), com_in_sole, atol=1e-14)
    assert at_sole.tree.total_mass == pytest.approx(at_pelvis.tree.total_mass)


def test_what_is_below_a_cut_is_unchanged_by_root_choice(both_roots):
    def names(robot, sensor):
        mask = robot.below_cut[sensor]
        return {link.name for link, below in zip(robot.tree.links, mask, strict=True) if below}

    for robot in both_roots:
        assert names(robot, "l_foot") == {"l_sole"}
        assert names(robot, "r_foot") == {"r_sole"}


def test_the_ankles_are_the_same_joints_whatever_the_root(both_roots):
    for robot in both_roots:
        assert {name: foot.ankle for name, foot in robot.feet.items()} == {
            "left": "l_ankle",
            "right": "r_ankle",
        }


def test_a_sensor_of_no_foot_has_its_child_side_below(both_roots, biped, biped_yaml):
    text = biped_yaml.replace("feet:\n", "feet: {}\nwas_feet:\n", 1)
    text = text[: text.index("was_feet")] + text[text.index("motors") :]
    biped.write_text(text.replace("r_foot: {", "knee: {joint: l_hip}\n  r_foot: {", 1))
    robot = load_robot(biped)
    below = robot.below_cut["knee"]
    beyond = robot.tree.subtree("l_hip")
    np.testing.assert_array_equal(below, beyond)
    assert not below[robot.tree.link_index["l_sole"]]


def test_subtrees_of_siblings_are_disjoint_and_the_root_is_above_all(both_roots):
    for robot in both_roots:
        tree = robot.tree
        assert tree.descendants[0].all()
        for k, joint in enumerate(tree.joints, start=1):
            below = tree.subtree(joint.name)
            assert not below[tree.parents[k]]
            siblings = [
                other for other in tree.joints if other.parent == joint.parent and other != joint
            ]
            for other in siblings:
                assert not (below & tree.subtree(other.name)).any()
