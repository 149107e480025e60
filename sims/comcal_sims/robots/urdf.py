# SPDX-License-Identifier: Apache-2.0
"""Writing a :class:`~comcal_sims.robots.model.RobotSpec` as URDF text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from comcal_sims.robots.model import Cuboid, JointSpec, LinkSpec, RobotSpec, Shape


def urdf_text(spec: RobotSpec) -> str:
    """Return the URDF of a robot; equal specs give equal text.

    Numbers carry 15 significant digits: enough that masses add up to the total in double
    precision, and few enough that 0.1 is written as 0.1.
    """
    root = ET.Element("robot", name=spec.name)
    joint_above = {joint.child: joint for joint in spec.joints}
    for link in spec.links:
        if link.name in joint_above:
            root.append(_joint(joint_above[link.name]))
        root.append(_link(link))
    ET.indent(root, space="  ")
    body = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0"?>\n{body}\n'


def _link(spec: LinkSpec) -> ET.Element:
    element = ET.Element("link", name=spec.name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(spec.lump.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=_number(spec.lump.mass))
    ixx, iyy, izz = (_number(value) for value in spec.inertia)
    ET.SubElement(inertial, "inertia", ixx=ixx, ixy="0", ixz="0", iyy=iyy, iyz="0", izz=izz)
    for shape in spec.visuals:
        _shape(ET.SubElement(element, "visual"), shape)
    for shape in spec.collisions:
        _shape(ET.SubElement(element, "collision"), shape)
    return element


def _shape(element: ET.Element, shape: Shape) -> None:
    ET.SubElement(element, "origin", xyz=_numbers(shape.centre), rpy="0 0 0")
    geometry = ET.SubElement(element, "geometry")
    if isinstance(shape, Cuboid):
        ET.SubElement(geometry, "box", size=_numbers(shape.size))
    else:
        ET.SubElement(geometry, "sphere", radius=_number(shape.radius))


def _joint(spec: JointSpec) -> ET.Element:
    kind = "fixed" if spec.axis is None else "revolute"
    element = ET.Element("joint", name=spec.name, type=kind)
    ET.SubElement(element, "parent", link=spec.parent)
    ET.SubElement(element, "child", link=spec.child)
    ET.SubElement(element, "origin", xyz=_numbers(spec.origin), rpy="0 0 0")
    if spec.axis is not None:
        ET.SubElement(element, "axis", xyz=_numbers(spec.axis))
        ET.SubElement(
            element,
            "limit",
            lower=_number(spec.lower),
            upper=_number(spec.upper),
            effort=_number(spec.effort),
            velocity=_number(spec.velocity),
        )
    return element


def _numbers(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return f"{value + 0.0:.15g}"  # + 0.0 turns -0 into 0
