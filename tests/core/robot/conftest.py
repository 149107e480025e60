# SPDX-License-Identifier: Apache-2.0
"""Robots for the tests: a small biped, and random trees of every joint type."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

BIPED_URDF = """<?xml version="1.0"?>
<robot name="small">
  <link name="pelvis">
    <inertial><origin xyz="0 0 0.1"/><mass value="10"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
  </link>
{legs}
</robot>
"""

LEG = """
  <link name="{s}_shin">
    <inertial><origin xyz="0 0 -0.2"/><mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
  </link>
  <link name="{s}_ankle_body">
    <inertial><origin xyz="0 0 0"/><mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
  </link>
  <link name="{s}_sole">
    <inertial><origin xyz="0.02 0 -0.02"/><mass value="0.3"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <collision><origin xyz="0.03 0 -0.03"/>
      <geometry><box size="0.2 0.1 0.02"/></geometry></collision>
  </link>
  <joint name="{s}_hip" type="revolute">
    <parent link="pelvis"/><child link="{s}_shin"/><origin xyz="0 {y} 0"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="50" velocity="1"/>
  </joint>
  <joint name="{s}_ankle" type="revolute">
    <parent link="{s}_shin"/><child link="{s}_ankle_body"/><origin xyz="0 0 -0.4"/>
    <axis xyz="0 -1 0"/><limit lower="-1" upper="1" effort="50" velocity="1"/>
  </joint>
  <joint name="{s}_foot_ft" type="fixed">
    <parent link="{s}_ankle_body"/><child link="{s}_sole"/><origin xyz="0 0 -0.05"/>
  </joint>
"""

BIPED_YAML = """\
format: comcal-robot/1
name: small
urdf: small.urdf
gravity: 9.81
base: floating
sensors:
  l_foot: {joint: l_foot_ft, sense: on_robot}
  r_foot: {joint: r_foot_ft, sense: on_ground, below: {mass: 300 g, com: [20 mm, 0, -0.02]}}
feet:
  left: {link: l_sole, sensor: l_foot}
  right: {link: r_sole, sensor: r_foot}
plates:
  floor: {frame: world, feet: [left, right]}
motors:
  l_hip: {torque_constant: 0.115, gear: 1.0, sign: 1}
  r_hip: {torque_constant: 115 mN m/A, sign: -1}
imu: {link: pelvis}
noise: {ft_force: 0.1, ft_moment: 1 N cm, encoder: 0.02 deg, revisit: {ft_force: 0.4}}
tolerances: {link_mass: 0.5 %, link_com: 1 mm, joint_offset: 0.04 deg}
sources: {can: {channel: can0, rates: [1, 2.5]}}
limits: {com_error: 5 mm, mass_error: 0.5 kg}
"""


@pytest.fixture(scope="session")
def biped_urdf():
    """The URDF text of a biped that stands at q = 0: hip roll, ankle pitch, sensor, sole."""
    legs = LEG.format(s="l", y="0.1") + LEG.format(s="r", y="-0.1")
    return BIPED_URDF.format(legs=legs)


@pytest.fixture(scope="session")
def biped_yaml():
    """The text of a robot.yaml that uses every key."""
    return BIPED_YAML


@pytest.fixture
def biped(tmp_path, biped_urdf, biped_yaml):
    """Path of the robot.yaml of the biped, with its URDF beside it."""
    (tmp_path / "small.urdf").write_text(biped_urdf)
    path = tmp_path / "robot.yaml"
    path.write_text(biped_yaml)
    return path


@pytest.fixture
def write(tmp_path):
    """Write a text to a file in the test's folder and return its path."""

    def write(name: str, text: str | bytes) -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def _words(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def _unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


@pytest.fixture(scope="session")
def random_urdf():
    """Return a writer of random trees: every joint type, rotated inertials, mimic chains."""

    def write_tree(rng: np.random.Generator, n_joints: int) -> str:
        parts = []
        names = ["base", *(f"link{k}" for k in range(n_joints))]
        for name in names:
            A = rng.normal(size=(3, 3))
            I = A @ A.T + 3.0 * np.eye(3)  # noqa: E741
            moments = "".join(
                f' i{"xyz"[i]}{"xyz"[j]}="{float(I[i, j])!r}"'
                for i in range(3)
                for j in range(i, 3)
            )
            parts.append(
                f'<link name="{name}"><inertial><origin xyz="{_words(rng.normal(size=3))}" '
                f'rpy="{_words(rng.uniform(-3, 3, 3))}"/>'
                f'<mass value="{float(rng.uniform(0.1, 5))!r}"/>'
                f"<inertia{moments}/></inertial></link>"
            )
        movable: list[str] = []
        joints = []
        for k in range(n_joints):
            kind = ["fixed", "revolute", "continuous", "prismatic"][int(rng.integers(4))]
            mimic = ""
            if kind in ("revolute", "prismatic") and movable and rng.uniform() < 0.3:
                leader = movable[int(rng.integers(len(movable)))]
                mimic = (
                    f'<mimic joint="{leader}" multiplier="{float(rng.normal())!r}" '
                    f'offset="{float(rng.normal())!r}"/>'
                )
            joints.append(
                f'<joint name="joint{k}" type="{kind}">'
                f'<parent link="{names[int(rng.integers(k + 1))]}"/>'
                f'<child link="link{k}"/><origin xyz="{_words(rng.normal(size=3))}" '
                f'rpy="{_words(rng.uniform(-3, 3, 3))}"/><axis xyz="{_words(_unit(rng))}"/>'
                f'<limit lower="-3" upper="3" effort="1" velocity="1"/>{mimic}</joint>'
            )
            if kind in ("revolute", "prismatic", "continuous"):
                movable.append(f"joint{k}")
        order = rng.permutation(len(joints))
        parts += [joints[i] for i in order]
        return f'<robot name="random">{"".join(parts)}</robot>'

    return write_tree
