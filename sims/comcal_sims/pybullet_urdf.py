# SPDX-License-Identifier: Apache-2.0
"""The URDF that pybullet loads: the robot's tree, and nothing of it that pybullet misreads.

It is written from the tree rather than loaded from the robot's file because a file may carry meshes
that are not there, flat feet whose contacts flicker, and links without ``<inertial>``, which
pybullet takes for 1 kg each. Links and joints are numbered, so that any name is safe.
"""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

from comcal.robot.model import Robot
from comcal.robot.tree import Array, Joint, JointType, Link
from comcal_sims.conventions import joint_name, link_name
from comcal_sims.footing import BUMPER_RADIUS, bumper_centres
from comcal_sims.rotations import rpy_from_rotation

LEAST_INERTIA = 1e-6
"""Added where a link has none, so that it can be accelerated; statics do not see it [kg m^2]."""
LEAST_BASE_MASS = 1e-6
"""Of a massless root, which pybullet would otherwise nail to the world [kg]."""


def cut_name(k: int) -> str:
    """Return the name of the fixed joint at which joint *k* of the tree is cut by a sensor.

    Under a motor pybullet leaves the motor's torque out of the wrench, so a movable joint with a
    sensor gets a massless link and a fixed joint of its own beyond the motor.
    """
    return f"cut{k}"


def bullet_urdf(robot: Robot) -> str:
    """Return the text of the URDF for pybullet.

    Parameters
    ----------
    robot : Robot
        Soles become balls under their corners; no other link touches anything.
    """
    tree = robot.tree
    cut = {sensor.joint for sensor in robot.sensors.values()}
    root = ET.Element("robot", name="robot")
    for k, link in enumerate(tree.links):
        feet = [foot for foot in robot.feet.values() if foot.link == link.name]
        balls = np.concatenate([np.zeros((0, 3)), *(bumper_centres(foot) for foot in feet)])
        _add_link(root, link_name(k), link, balls, LEAST_BASE_MASS if k == 0 else 0.0)
    for k, joint in enumerate(tree.joints):
        parent, child = link_name(int(tree.parents[k + 1])), link_name(k + 1)
        if joint.is_movable and joint.name in cut:
            between = f"{cut_name(k)}_link"
            nothing = Link(between, 0.0, np.zeros(3), np.zeros((3, 3)))
            _add_link(root, between, nothing, np.zeros((0, 3)), 0.0)
            _add_joint(root, joint_name(k), joint, parent, between)
            fixed = Joint(cut_name(k), JointType.FIXED, between, child, np.eye(4), np.zeros(3))
            _add_joint(root, cut_name(k), fixed, between, child)
        else:
            _add_joint(root, joint_name(k), joint, parent, child)
    ET.indent(root)  # pybullet breaks lines of over 1024 characters, in the middle of a word
    return ET.tostring(root, encoding="unicode")


def _add_link(root: ET.Element, name: str, link: Link, balls: Array, least_mass: float) -> None:
    element = ET.SubElement(root, "link", name=name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(link.com))
    ET.SubElement(inertial, "mass", value=repr(max(float(link.mass), least_mass)))
    inertia = link.inertia
    if np.trace(inertia) <= 0.0:
        inertia = LEAST_INERTIA * np.eye(3)
    entries = {f"i{a}{b}": repr(float(inertia[i, j])) for a, b, i, j in _UPPER}
    ET.SubElement(inertial, "inertia", entries)
    for centre in balls:
        collision = ET.SubElement(element, "collision")
        ET.SubElement(collision, "origin", xyz=_text(centre))
        geometry = ET.SubElement(collision, "geometry")
        ET.SubElement(geometry, "sphere", radius=repr(BUMPER_RADIUS))


def _add_joint(root: ET.Element, name: str, joint: Joint, parent: str, child: str) -> None:
    kind = "continuous" if joint.kind is JointType.REVOLUTE else joint.kind.value
    element = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    T = joint.T_parent_joint
    ET.SubElement(element, "origin", xyz=_text(T[:3, 3]), rpy=_text(rpy_from_rotation(T[:3, :3])))
    if joint.is_movable:
        ET.SubElement(element, "axis", xyz=_text(joint.axis))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


_UPPER = [(a, b, i, j) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if j >= i]
