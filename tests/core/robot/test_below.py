# SPDX-License-Identifier: Apache-2.0
"""What robot.yaml says hangs below a cut replaces what the URDF says, everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links

GIVEN = "below: {mass: 300 g, com: [20 mm, 0, -0.02]}"
"""The r_foot of the small biped, whose URDF has the same."""


def loaded(biped, text, old=GIVEN, new=""):
    assert old in text
    biped.write_text(text.replace(old, new))
    return load_robot(biped)


def test_what_the_urdf_has_anyway_changes_nothing(biped, biped_yaml):
    stated, plain = load_robot(biped), loaded(biped, biped_yaml, ", " + GIVEN)
    np.testing.assert_array_equal(stated.tree.masses, plain.tree.masses)
    np.testing.assert_allclose(stated.tree.coms, plain.tree.coms, atol=1e-15)
    for a, b in zip(stated.tree.links, plain.tree.links, strict=True):
        np.testing.assert_allclose(a.inertia, b.inertia, atol=1e-15)


def test_the_stated_mass_and_com_are_those_of_the_tree(biped, biped_yaml):
    new = "below: {override: true, mass: 1.7, com: [0.01, 0.02, -0.03]}"
    robot = loaded(biped, biped_yaml, new=new)
    below = robot.below_cut["r_foot"]
    assert robot.tree.masses[below].sum() == 1.7
    rng = np.random.default_rng(1)
    at = place_links(robot.tree, rng.normal(0, 0.5, (3, len(robot.tree.joint_names))))
    R, p = at.joint("r_foot_ft")
    m = robot.tree.masses * below
    com = np.einsum("k,nki->ni", m, at.coms) / m.sum()
    np.testing.assert_allclose(com, p + R @ [0.01, 0.02, -0.03], atol=1e-14)
    other = robot.tree.links[robot.tree.link_index["l_sole"]]
    assert other.mass == 0.3
    # 1.7 / 0.3 of what the URDF has: some body has it.
    sole = robot.tree.links[robot.tree.link_index["r_sole"]]
    np.testing.assert_allclose(sole.inertia, np.eye(3) * 0.001 * 1.7 / 0.3, atol=1e-15)


TOE = """
  <link name="r_toe"><inertial><origin xyz="0.02 0 0"/><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="r_toe_joint" type="revolute"><parent link="r_sole"/><child link="r_toe"/>
    <origin xyz="0.1 0 -0.01" rpy="0 0.3 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
</robot>"""


def test_several_links_below_one_cut_become_one_rigid_body(biped, biped_yaml, biped_urdf, write):
    write("small.urdf", biped_urdf.replace("</robot>", TOE))
    plain = loaded(biped, biped_yaml, ", " + GIVEN)
    robot = loaded(biped, biped_yaml, new="below: {mass: 0.4 kg, com: [0.03, 0, -0.02]}")
    mask = robot.below_cut["r_foot"]
    assert mask.sum() == 2
    assert robot.tree.masses[mask].sum() == 0.4
    toe = robot.tree.links[robot.tree.link_index["r_toe"]]
    assert toe.mass == 0.0
    assert not toe.has_inertial
    # The inertia of both together as the URDF has them, about their common CoM.
    at = place_links(plain.tree, np.zeros((1, len(plain.tree.joint_names))))
    k, t = (plain.tree.link_index[n] for n in ("r_sole", "r_toe"))
    d = at.coms[0, t] - at.coms[0, k]
    reduced = 0.3 * 0.1 / 0.4 * (d @ d * np.eye(3) - np.outer(d, d))
    parts = sum(at.R[0, i] @ plain.tree.links[i].inertia @ at.R[0, i].T for i in (k, t))
    sole = robot.tree.links[robot.tree.link_index["r_sole"]]
    np.testing.assert_allclose(sole.inertia, parts + reduced, atol=1e-15)


ROOTED = """<robot name="small">
  <link name="sole"><inertial><origin xyz="0.02 0 0.03"/><mass value="0.3"/></inertial></link>
  <link name="body"><inertial><origin xyz="0 0 0.3"/><mass value="5"/></inertial></link>
  <joint name="ft" type="fixed"><parent link="sole"/><child link="body"/>
    <origin xyz="0 0.01 0.05" rpy="0.3 -1.2 2.0"/></joint>
</robot>"""


def test_the_foot_may_be_the_root(biped, write):
    write("small.urdf", ROOTED)
    biped.write_text(
        "format: comcal-robot/1\nname: small\nurdf: small.urdf\n"
        "sensors:\n  ft: {joint: ft, below: {override: true, mass: 0.5, com: [0.01, 0.02, 0.03]}}\n"
        "feet:\n  only: {link: sole, sensor: ft}\n"
    )
    robot = load_robot(biped)
    assert robot.below_cut["ft"].tolist() == [True, False]
    assert robot.tree.masses.tolist() == [0.5, 5.0]
    T = robot.tree.joints[0].T_parent_joint
    np.testing.assert_allclose(
        robot.tree.coms[0], T[:3, :3] @ [0.01, 0.02, 0.03] + T[:3, 3], atol=1e-15
    )
    assert np.abs(robot.tree.coms[0] - [0.01, 0.02, 0.03]).max() > 0.01


def test_two_cuts_of_one_leg_cannot_both_state_what_is_below(biped, biped_yaml):
    two = "  ankle: {joint: r_ankle, below: {mass: 0.8, com: [0, 0, 0]}}\nfeet:"
    biped.write_text(biped_yaml.replace("feet:", two, 1))
    with pytest.raises(ConfigError, match="one cut is below the other"):
        load_robot(biped)
