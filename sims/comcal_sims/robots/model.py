# SPDX-License-Identifier: Apache-2.0
"""A robot as it is about to be written: bodies, joints and the simple shapes they are made of.

Inertias are diagonal in the link axes, so the inertial frame of every link is parallel to its link
frame. Physics engines report sensor readings in inertial axes; here these are the link axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.robot.frames import transform_from
from comcal.robot.tree import Box, Joint, JointType, Link, Tree

Vector = tuple[float, float, float]

ORIGIN: Vector = (0.0, 0.0, 0.0)
X_AXIS: Vector = (1.0, 0.0, 0.0)
Y_AXIS: Vector = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Sphere:
    """A ball of *radius* [m] around *centre* in the link frame [m]."""

    radius: float
    centre: Vector = ORIGIN

    @property
    def bounding_size(self) -> Vector:
        """Edges of the smallest box around it [m]."""
        return (2 * self.radius, 2 * self.radius, 2 * self.radius)


@dataclass(frozen=True)
class Cuboid:
    """A box of full edge lengths *size* [m], parallel to the link axes, around *centre* [m]."""

    size: Vector
    centre: Vector = ORIGIN

    @property
    def bounding_size(self) -> Vector:
        """Edges of the smallest box around it [m]."""
        return self.size


Shape = Sphere | Cuboid


@dataclass(frozen=True)
class Lump:
    """A mass [kg] and its CoM [m] in a frame that the context names."""

    mass: float
    com: Vector

    def without(self, *parts: Lump) -> Lump:
        """Return what is left when *parts* are cut out, so that all together are this lump again.

        Raises
        ------
        ValueError
            If the parts weigh as much as the whole or more.
        """
        mass = self.mass - sum(part.mass for part in parts)
        if mass <= 0.0:
            raise ValueError(f"parts cut out of {self.mass:g} kg leave {mass:g} kg")
        moment = self.mass * np.array(self.com)
        for part in parts:
            moment = moment - part.mass * np.array(part.com)
        x, y, z = (float(value) for value in moment / mass)
        return Lump(mass, (x, y, z))


@dataclass(frozen=True)
class LinkSpec:
    """One rigid body to write.

    Parameters
    ----------
    name : str
    lump : Lump
        Mass and CoM, in the link frame.
    inertia : tuple of 3 float
        Principal moments ``ixx, iyy, izz`` about the CoM in the link axes [kg m^2].
    visuals, collisions : tuple of Shape
        What is drawn, and what touches the ground.
    """

    name: str
    lump: Lump
    inertia: Vector
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()


@dataclass(frozen=True)
class JointSpec:
    """One joint to write; revolute about *axis*, or fixed when *axis* is None.

    Parameters
    ----------
    origin : tuple of 3 float
        Joint frame in the parent link [m]; its axes are parallel to the parent's at q = 0.
    lower, upper : float
        Limits [rad].
    effort, velocity : float
        Limits [N m], [rad/s].
    """

    name: str
    parent: str
    child: str
    origin: Vector
    axis: Vector | None = None
    lower: float = -np.pi
    upper: float = np.pi
    effort: float = 200.0
    velocity: float = 6.0


@dataclass(frozen=True)
class RobotSpec:
    """Links and joints, parents first; ``links[0]`` is the root."""

    name: str
    links: tuple[LinkSpec, ...]
    joints: tuple[JointSpec, ...]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the movable joints, in the order of the file."""
        return tuple(joint.name for joint in self.joints if joint.axis is not None)

    def tree(self) -> Tree:
        """Return the tree that reading the written URDF gives."""
        links = {link.name: _tree_link(link) for link in self.links}
        children = [links[joint.child] for joint in self.joints]
        joints = tuple(_tree_joint(joint) for joint in self.joints)
        return Tree(self.name, (links[self.links[0].name], *children), joints)


def cuboid_inertia(mass: float, size: Vector) -> Vector:
    """Return the principal moments of a solid box of edges *size* [m] about its centre [kg m^2]."""
    x, y, z = size
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)


def cuboid_link(name: str, lump: Lump, shape: Cuboid) -> LinkSpec:
    """Return a link drawn as *shape*, with the inertia of that box moved to its CoM."""
    return LinkSpec(name, lump, cuboid_inertia(lump.mass, shape.size), visuals=(shape,))


def _tree_link(spec: LinkSpec) -> Link:
    boxes = tuple(
        Box(transform_from(np.eye(3), shape.centre), np.array(shape.bounding_size))
        for shape in spec.collisions
    )
    com, inertia = np.array(spec.lump.com), np.diag(spec.inertia)
    return Link(spec.name, spec.lump.mass, com, inertia, boxes=boxes)


def _tree_joint(spec: JointSpec) -> Joint:
    T = transform_from(np.eye(3), spec.origin)
    if spec.axis is None:
        return Joint(spec.name, JointType.FIXED, spec.parent, spec.child, T, np.zeros(3))
    return Joint(
        spec.name,
        JointType.REVOLUTE,
        spec.parent,
        spec.child,
        T,
        np.array(spec.axis),
        spec.lower,
        spec.upper,
        spec.effort,
    )
