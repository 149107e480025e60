# SPDX-License-Identifier: Apache-2.0
"""The kinematic tree: links with their inertials, joints with their axes.

Everything is SI and radians. Link ``k`` (``k >= 1``) hangs on joint ``k - 1``; link 0 is the root.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from comcal.robot.bodies import Bodies

Array = npt.NDArray[np.float64]


class JointType(Enum):
    """The joint types of URDF that comcal understands."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


class Shape(Enum):
    """What fills the bounding box of a collision geometry."""

    BOX = "box"
    SPHERE = "sphere"
    CYLINDER = "cylinder"
    """Its axis is the z of the box."""


@dataclass(frozen=True)
class Box:
    """The box that a link's collision geometry fills, in the link frame.

    Parameters
    ----------
    T_link_box : array, shape (4, 4)
        Pose of the box centre in the link frame [m].
    size : array, shape (3,)
        Full edge lengths [m].
    shape : Shape
        What is inside: a sphere touches the ground in one point, a box with a face.
    """

    T_link_box: Array
    size: Array
    shape: Shape = Shape.BOX


@dataclass(frozen=True)
class Link:
    """One rigid body.

    Parameters
    ----------
    name : str
    mass : float
        [kg]; NaN where no URDF gives it (chains without URDF).
    com : array, shape (3,)
        Centre of mass in the link frame [m].
    inertia : array, shape (3, 3)
        About the centre of mass, in the axes of the link frame [kg m^2].
    has_inertial : bool
        Whether the URDF has an ``<inertial>`` for this link; without one the mass is zero.
    boxes : tuple of Box
        Bounding boxes of the collision geometry (spheres and cylinders too); empty for meshes.
    """

    name: str
    mass: float
    com: Array
    inertia: Array
    has_inertial: bool = True
    boxes: tuple[Box, ...] = ()


@dataclass(frozen=True)
class Mimic:
    """``q = multiplier * q_of(joint) + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint between ``parent`` and ``child`` (link names).

    Parameters
    ----------
    T_parent_joint : array, shape (4, 4)
        Pose of the joint frame (= child link frame at q = 0) in the parent link frame [m].
    axis : array, shape (3,)
        Unit vector in the joint frame; zero for fixed joints.
    lower, upper : float
        Limits [rad] or [m]; infinite where none are given.
    effort : float
        Largest torque [N m] or force [N]; infinite where not given.
    """

    name: str
    kind: JointType
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    lower: float = -np.inf
    upper: float = np.inf
    effort: float = np.inf
    mimic: Mimic | None = None

    @property
    def is_movable(self) -> bool:
        """Whether the joint has a position at all."""
        return self.kind is not JointType.FIXED


@dataclass(frozen=True)
class Tree:
    """Links and joints in topological order: parents before children.

    Parameters
    ----------
    name : str
    links : tuple of Link
        ``links[0]`` is the root; ``links[k]`` is the child of ``joints[k - 1]``.
    joints : tuple of Joint
    geometry_known : bool
        False for chains described without URDF: only rotations have a meaning then.
    notes : tuple of str
        What is doubtful in the URDF and how it was read, in words, for the health check.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    geometry_known: bool = True
    notes: tuple[str, ...] = ()

    @cached_property
    def link_index(self) -> dict[str, int]:
        """Index of every link by name."""
        return {link.name: k for k, link in enumerate(self.links)}

    @cached_property
    def joint_index(self) -> dict[str, int]:
        """Index of every joint (fixed ones included) by name."""
        return {joint.name: k for k, joint in enumerate(self.joints)}

    @cached_property
    def parents(self) -> npt.NDArray[np.intp]:
        """Index of each link's parent link, shape (n_links,); -1 for the root."""
        index = self.link_index
        return np.array([-1] + [index[joint.parent] for joint in self.joints], dtype=np.intp)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the independent joints, the order of every ``q`` in comcal."""
        return tuple(j.name for j in self.joints if j.is_movable and j.mimic is None)

    @cached_property
    def masses(self) -> Array:
        """Link masses, shape (n_links,) [kg]."""
        return np.array([link.mass for link in self.links])

    @cached_property
    def coms(self) -> Array:
        """Link CoMs in their link frames, shape (n_links, 3) [m]."""
        return np.array([link.com for link in self.links])

    @cached_property
    def total_mass(self) -> float:
        """Sum of all link masses [kg]."""
        return float(self.masses.sum())

    @cached_property
    def descendants(self) -> npt.NDArray[np.bool_]:
        """``descendants[i, k]``: link k is link i or hangs below it, shape (n_links, n_links)."""
        n = len(self.links)
        mask = np.eye(n, dtype=np.bool_)
        for k in range(n - 1, 0, -1):
            mask[self.parents[k]] |= mask[k]
        return mask

    @cached_property
    def bodies(self) -> Bodies:
        """What moves as one: links joined by fixed joints (:mod:`comcal.robot.bodies`)."""
        from comcal.robot.bodies import bodies_of  # it needs this module first

        return bodies_of(self)

    def subtree(self, joint: str) -> npt.NDArray[np.bool_]:
        """Return which links lie beyond *joint* (child side), shape (n_links,)."""
        return self.descendants[self.joint_index[joint] + 1]
