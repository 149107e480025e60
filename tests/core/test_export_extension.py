# SPDX-License-Identifier: Apache-2.0
"""What a URDF holds of an extension reads back as that extension; the rest has a place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from comcal.effects.extend import extend
from comcal.effects.registry import effects
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes_kinds import Realisation
from comcal.robot.changes_table import EFFECTS
from comcal.robot.changes_text import parse_change
from comcal.robot.changes_yaml import KnownChange
from comcal.robot.description import load_robot
from comcal.robot.model import BelowCut
from comcal.robot.urdf import parse_urdf
from comcal.robot.urdf_write import InertialEdit, OriginEdit, write_inertials, write_origins
from comcal.workflow.urdf_parts import parts_of, rest_of, written_urdf

BODIES = (
    "payload@torso:mass=3,com_x=0.05,com_z=0.2",
    "payload@torso:mass=1,com_y=-0.1",
    "link_mass@l_thigh:mass=0.5",
    "link_com@pelvis:com_x=0.01,com_z=-0.02",
    "sole_mass@r_foot:mass=0.2",
    "link_length@l_knee:z=-0.01,x=0.002",
)
READINGS = ("ft_gain@r_foot:gain_fz=0.05", "joint_offset@waist_pitch:offset=0.02")


def known(*texts: str) -> list[KnownChange]:
    return [KnownChange(parse_change(text)) for text in texts]


@pytest.fixture(scope="module")
def table(biped14) -> PoseTable:
    return biped14.measure(biped14.plan[::5])


def test_the_new_urdf_is_the_robot_that_the_extension_describes(biped14, table, tmp_path) -> None:
    robot = biped14.robot
    wanted = extend(robot, table, known(*BODIES)).robot
    old = robot.urdf_path.read_bytes()
    new = written_urdf(old, "new.urdf", robot, wanted)
    tree = parse_urdf(new, "new.urdf")
    np.testing.assert_allclose(tree.masses, wanted.tree.masses, rtol=1e-8)
    np.testing.assert_allclose(tree.coms, wanted.tree.coms, atol=1e-8)
    for found, link in zip(tree.links, wanted.tree.links, strict=True):
        np.testing.assert_allclose(found.inertia, link.inertia, rtol=1e-7, atol=1e-9)
    for found, joint in zip(tree.joints, wanted.tree.joints, strict=True):
        np.testing.assert_allclose(found.T_parent_joint, joint.T_parent_joint, atol=1e-8)
    lines = zip(old.splitlines(), new.splitlines(), strict=True)
    changed = [line for line, other in lines if line != other]
    assert all(b"<origin" in line or b"<mass" in line or b"<inertia " in line for line in changed)
    # torso, thigh, sole: mass and inertia; torso, pelvis, joint: origin
    assert len(changed) == 9


def test_urdf_and_rest_together_are_the_whole_extension(biped14, table, tmp_path) -> None:
    robot, whole = biped14.robot, known(*BODIES, *READINGS)
    parts = parts_of(robot, whole)
    assert [entry.change.effect for entry in rest_of(parts)] == ["ft_gain", "joint_offset"]
    held = [part.known for part in parts if part.in_urdf]
    urdf = tmp_path / robot.urdf_path.name
    nominal = robot.urdf_path.read_bytes()
    urdf.write_bytes(written_urdf(nominal, urdf.name, robot, extend(robot, table, held).robot))
    again = load_robot(robot.yaml_path, urdf=urdf)
    rows = []
    for base, changes in ((robot, whole), (again, rest_of(parts))):
        part = extend(base, table, changes)
        rows.append(parity(Assumed(part.robot), part.table).values)
    np.testing.assert_allclose(rows[0], rows[1], atol=2e-6)
    assert np.abs(rows[0] - parity(Assumed(robot), table).values).max() > 1.0


def test_the_payload_of_the_catalogue_is_a_point_to_pinocchio(biped14, table) -> None:
    robot = biped14.robot
    k = robot.tree.link_index["torso"]
    old = robot.tree.links[k]
    new = extend(robot, table, known(BODIES[0])).robot.tree.links[k]
    body = pin.Inertia(old.mass, old.com, old.inertia)
    body = body + pin.Inertia(3.0, np.array([0.05, 0.0, 0.2]), np.zeros((3, 3)))
    assert new.mass == pytest.approx(body.mass)
    np.testing.assert_allclose(new.com, body.lever, atol=1e-12)
    np.testing.assert_allclose(new.inertia, body.inertia, atol=1e-12)


def test_every_effect_has_a_place(biped14) -> None:
    """Those that a URDF holds are bodies and lengths; nothing that is found goes nowhere."""
    robot = biped14.robot
    targets = {"link": "torso", "joint": "l_knee", "sensor": "l_foot", "foot": "left", "imu": "imu"}
    held = set()
    for name in effects():
        spec = EFFECTS[name]
        kind = next(iter(sorted(spec.targets, key=lambda t: t.value))).value
        change = parse_change("ground_tilt:roll=0")
        change = replace(change, effect=name, target=targets.get(kind, ""), parameters={})
        (part,) = parts_of(robot, [KnownChange(change)])
        if part.in_urdf:
            held.add(name)
            assert spec.realisation is Realisation.ENGINE
    assert held == {"payload", "link_mass", "link_com", "link_length", "sole_mass"}


def test_numbers_that_belong_into_robot_yaml_are_given(biped14) -> None:
    constant = biped14.robot.motors["l_knee"].torque_constant
    parts = parts_of(biped14.robot, known("torque_constant@l_knee:relative=0.1"))
    assert f"{1.1 * constant:.6g} instead of {constant:.6g}" in parts[0].belongs


def test_what_robot_yaml_states_of_a_link_stays_there(biped14, table) -> None:
    robot = biped14.robot
    stated = replace(robot.sensors["r_foot"], below=BelowCut(0.4, np.zeros(3)))
    robot = replace(robot, sensors={**robot.sensors, "r_foot": stated})
    texts = ("payload@r_sole:mass=1", "sole_mass@r_foot:mass=0.1")
    parts = parts_of(robot, known(*texts))
    assert [part.in_urdf for part in parts] == [False, False]
    assert all("sensors.r_foot.below" in part.belongs for part in parts)
    wanted = extend(robot, table, known(*texts)).robot
    raw = robot.urdf_path.read_bytes()
    assert written_urdf(raw, "new.urdf", robot, wanted) == raw


BARE = b"""<robot name="r">
  <link name="a"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="revolute">
    <parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <link name="b"/>
</robot>"""


def test_an_origin_that_is_not_there_is_added_to_a_joint() -> None:
    new = write_origins(BARE, "r.urdf", [OriginEdit("j", (0.1, 0.0, -0.2))])
    T = parse_urdf(new, "r.urdf").joints[0].T_parent_joint
    np.testing.assert_allclose(T[:3, 3], [0.1, 0.0, -0.2])
    assert b'<origin xyz="0.1 0 -0.2"/>' in new
    again = write_origins(new, "r.urdf", [OriginEdit("j", (-0.1, 0.0, 0.0))])
    assert b'<origin xyz="0 0 -0.2"/>' in again


def test_a_body_joins_an_inertial_with_turned_axes() -> None:
    """Pinocchio adds a point mass to the link as it is read, and reads the new one, too."""
    origin = b'<origin xyz="0.01 0.02 0.03" rpy="0.3 -0.2 0.5"/><mass value="2"/>'
    raw = BARE.replace(b'<mass value="2"/>', origin).replace(b'ixx="1"', b'ixx="0.3"')
    raw = raw.replace(b'ixy="0"', b'ixy="0.05"')
    link = parse_urdf(raw, "r.urdf").links[0]
    body = pin.Inertia(link.mass, link.com, link.inertia)
    body = body + pin.Inertia(1.5, np.array([0.1, -0.05, 0.2]), np.zeros((3, 3)))
    edit = InertialEdit("a", tuple(body.lever), joined=(1.5, body.inertia - link.inertia))
    new = write_inertials(raw, "r.urdf", [edit])
    read = pin.buildModelFromXML(new.decode(), pin.JointModelFreeFlyer()).inertias[1]
    assert read.mass == pytest.approx(3.5)
    np.testing.assert_allclose(read.lever, body.lever, atol=1e-8)
    np.testing.assert_allclose(read.inertia, body.inertia, atol=1e-8)


def test_a_body_joins_an_inertial_without_origin() -> None:
    edit = InertialEdit("a", (0.0, 0.0, 0.1), joined=(1.0, np.diag([0.5, 0.25, 0.0])))
    link = parse_urdf(write_inertials(BARE, "r.urdf", [edit]), "r.urdf").links[0]
    assert link.mass == 3.0
    np.testing.assert_allclose(link.com, [0.0, 0.0, 0.1])
    np.testing.assert_allclose(link.inertia, np.diag([1.5, 1.25, 1.0]))
