# SPDX-License-Identifier: Apache-2.0
"""A tree reduced to what its centre of mass needs: moving joints, constant turns, constant vectors.

Links that cannot move against each other become one body. Every joint is turned so that its axis is
z; what is left between a joint and the one before it is a constant rotation and a constant offset.
Of the bodies only the vectors of the statically equivalent chain remain (Cotton 2008, sections 2-3,
walked link by link): for body *i*, with everything divided by the mass of the robot,

    k_i = sum of its first moments + sum over the joints c on it of mu_c p_c

where mu_c is the share of the mass beyond joint c and p_c is where that joint sits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array, Joint, JointType, Tree


@dataclass(frozen=True)
class Moved:
    """A joint that moves mass, with the body it carries.

    Parameters
    ----------
    joint : Joint
        What it is called, its kind, and what it mimics.
    column : int
        Which position of ``tree.joint_names`` moves it.
    parent : int
        Index of the joint before it among the moving ones; -1 when it sits on the root body.
    C : array, shape (3, 3)
        Axes of this joint's frame, z along the joint's axis, in those of the frame before it.
    share : float
        Mass beyond the joint over the mass of the robot [1].
    k : array, shape (3,)
        Constant vector of the body in this joint's frame [m].
    links : tuple of str
        The links that make up the body.
    """

    joint: Joint
    column: int
    parent: int
    C: Array
    share: float
    k: Array
    links: tuple[str, ...]

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return self.joint.kind is JointType.PRISMATIC


@dataclass(frozen=True)
class MovedChain:
    """The joints that move mass, parents before children, and the root body.

    Parameters
    ----------
    moved : tuple of Moved
    k_root : array, shape (3,)
        Constant vector of the root body in the root link frame [m].
    root_links : tuple of str
        The links that do not move in the root link frame.
    """

    moved: tuple[Moved, ...]
    k_root: Array
    root_links: tuple[str, ...]

    def has_children(self, i: int) -> bool:
        """Whether another joint that moves mass sits on body *i*."""
        return any(other.parent == i for other in self.moved)


def frame_with_z(axis: Array) -> Array:
    """Return a rotation whose third column is the unit vector *axis*, shape (3, 3).

    The freedom about the axis goes into zeros and ones: a signed permutation when the axis lies
    along a coordinate axis, and a one where it lies in a coordinate plane.
    """
    size = np.abs(axis)
    longest = int(np.argmax(size))
    smallest = min(((longest + 2) % 3, (longest + 1) % 3), key=lambda i: float(size[i]))
    x = np.cross(np.eye(3)[smallest], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def moved_chain(tree: Tree) -> MovedChain:
    """Reduce *tree* to the joints that move mass; the others do not change the CoM.

    Parameters
    ----------
    tree : Tree
        With finite masses that do not add up to zero.
    """
    column = {name: i for i, name in enumerate(tree.joint_names)}
    loaded = tree.descendants @ (tree.masses != 0.0)
    frames: list[tuple[int, Array, Array]] = [(-1, np.eye(3), np.zeros(3))]
    moving: list[tuple[Joint, int, Array, Array, float]] = []
    for k, joint in enumerate(tree.joints, start=1):
        body, R, p = frames[tree.parents[k]]
        R_joint = R @ joint.T_parent_joint[:3, :3]
        p_joint = p + R @ joint.T_parent_joint[:3, 3]
        if joint.is_movable and loaded[k]:
            C = frame_with_z(_snapped(R_joint @ joint.axis))
            share = float(tree.masses[tree.descendants[k]].sum() / tree.total_mass)
            frames.append((len(moving), C.T @ R_joint, np.zeros(3)))
            moving.append((joint, body, C, p_joint, share))
        else:
            frames.append((body, R_joint, p_joint))
    k_of = {body: np.zeros(3) for body in range(-1, len(moving))}
    links: dict[int, list[str]] = {body: [] for body in k_of}
    for link, (body, R, p) in zip(tree.links, frames, strict=True):
        k_of[body] += link.mass / tree.total_mass * (p + R @ link.com)
        links[body].append(link.name)
    for _, body, _, p, share in moving:
        k_of[body] += share * p
    moved = tuple(
        Moved(
            joint,
            column[joint.mimic.joint if joint.mimic else joint.name],
            body,
            C,
            share,
            k_of[i],
            tuple(links[i]),
        )
        for i, (joint, body, C, _, share) in enumerate(moving)
    )
    return MovedChain(moved, k_of[-1], tuple(links[-1]))


def _snapped(axis: Array) -> Array:
    """Return a unit vector without the dust that sines of quarter turns leave behind."""
    clean = np.where(np.abs(axis) < 4 * np.finfo(float).eps, 0.0, axis)
    return clean / np.linalg.norm(clean)
