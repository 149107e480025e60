# SPDX-License-Identifier: Apache-2.0
"""The ``<link>`` elements of a URDF: inertials and the boxes that their collisions fill."""

from __future__ import annotations

import numpy as np

from comcal.robot.tree import Array, Box, Link, Shape
from comcal.robot.urdf_xml import Element, UrdfXml

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def read_link(xml: UrdfXml, name: str, element: Element) -> Link:
    """Read one ``<link>``.

    Parameters
    ----------
    xml : UrdfXml
        The file, for messages.
    name : str
    element : Element

    Returns
    -------
    Link
        Inertia about the CoM in the axes of the *link* frame: the rotation of the inertial's
        ``<origin>`` is resolved. Without ``<inertial>`` everything is zero. A negative mass is
        kept; the health check reports it.

    Raises
    ------
    UrdfError
        If a number is missing, not finite, or a size is negative.
    """
    boxes = tuple(
        box
        for collision in element.iterchildren("collision")
        for box in _read_collision(xml, collision)
    )
    inertial = xml.first_child(element, "inertial")
    if inertial is None:
        return Link(name, 0.0, np.zeros(3), np.zeros((3, 3)), has_inertial=False, boxes=boxes)
    mass = xml.required_child(inertial, "mass")
    xml.expect_attributes(mass, ("value",))
    T_link_inertial = xml.origin(inertial)
    R = T_link_inertial[:3, :3]
    inertia = R @ _read_inertia(xml, inertial) @ R.T
    return Link(name, xml.number(mass, "value"), T_link_inertial[:3, 3], inertia, boxes=boxes)


def _read_inertia(xml: UrdfXml, inertial: Element) -> Array:
    """Return the 3x3 inertia in the axes of the inertial frame; zero where none is written."""
    element = xml.first_child(inertial, "inertia")
    if element is None:
        return np.zeros((3, 3))
    xml.expect_attributes(element, _MOMENTS)
    xx, xy, xz, yy, yz, zz = (xml.number(element, moment, 0.0) for moment in _MOMENTS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _read_collision(xml: UrdfXml, collision: Element) -> list[Box]:
    """Return the bounding box of one ``<collision>``; none for meshes and unknown shapes."""
    geometry = xml.first_child(collision, "geometry")
    T_link_box = xml.origin(collision)
    if geometry is None:
        return []
    boxes: list[Box] = []
    for shape in geometry.iterchildren("box", "sphere", "cylinder"):
        kind = Shape(str(shape.tag))
        if kind is Shape.BOX:
            xml.text(shape, "size")
            size = xml.vector(shape, "size", (0.0, 0.0, 0.0))
        else:
            width = 2.0 * xml.number(shape, "radius")
            height = width if kind is Shape.SPHERE else xml.number(shape, "length")
            size = np.array([width, width, height])
        if (size < 0.0).any():
            raise xml.error(shape, f"a <{shape.tag}> cannot have a negative size")
        boxes.append(Box(T_link_box, size, kind))
    return boxes
