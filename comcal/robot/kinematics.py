# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics of N poses at once, in the frame of the root link."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import apply, rotation_about
from comcal.robot.tree import Array, JointType, Tree


@dataclass(frozen=True)
class Placements:
    """Where every link is, in the root link frame, for N poses.

    Parameters
    ----------
    tree : Tree
    R : array, shape (N, n_links, 3, 3)
        Link axes in the root frame.
    p : array, shape (N, n_links, 3)
        Link origins in the root frame [m]; the origin of link ``k`` is that of joint ``k - 1``.
    """

    tree: Tree
    R: Array
    p: Array

    def link(self, name: str) -> tuple[Array, Array]:
        """Return rotation (N, 3, 3) and origin (N, 3) of a link frame in the root frame."""
        k = self.tree.link_index[name]
        return self.R[:, k], self.p[:, k]

    def joint(self, name: str) -> tuple[Array, Array]:
        """Return rotation and origin of a joint's frame (its child side) in the root frame."""
        k = self.tree.joint_index[name] + 1
        return self.R[:, k], self.p[:, k]

    @cached_property
    def coms(self) -> Array:
        """Link CoMs in the root frame, shape (N, n_links, 3) [m]."""
        return self.p + apply(self.R, self.tree.coms)

    def total_com(self) -> Array:
        """Return the CoM of the whole tree in the root frame, shape (N, 3) [m]."""
        m = self.tree.masses
        return np.einsum("k,nki->ni", m, self.coms) / m.sum()

    def axes(self) -> Array:
        """Return the axis of every joint (fixed ones zero) in the root frame, (N, n_joints, 3).

        A joint's axis does not change with its own angle, so the child frame may express it.
        """
        local = np.array([j.axis for j in self.tree.joints]).reshape(-1, 3)
        return apply(self.R[:, 1:], local)


def place_links(tree: Tree, q: npt.ArrayLike) -> Placements:
    """Place every link of *tree* for N joint vectors at once.

    Parameters
    ----------
    tree : Tree
    q : array, shape (N, n_joints)
        Joint positions [rad] or [m], in the order of ``tree.joint_names``.

    Returns
    -------
    Placements
        In the frame of the root link; where the root is in the world is not determined here.
    """
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    column = {name: i for i, name in enumerate(tree.joint_names)}
    n_poses, n_links = q.shape[0], len(tree.links)
    R = np.empty((n_poses, n_links, 3, 3))
    p = np.empty((n_poses, n_links, 3))
    R[:, 0], p[:, 0] = np.eye(3), 0.0
    for k, joint in enumerate(tree.joints, start=1):
        parent = tree.parents[k]
        R_joint = R[:, parent] @ joint.T_parent_joint[:3, :3]
        p_joint = p[:, parent] + apply(R[:, parent], joint.T_parent_joint[:3, 3])
        if joint.is_movable:
            if joint.mimic is None:
                qj = q[:, column[joint.name]]
            else:
                qj = joint.mimic.multiplier * q[:, column[joint.mimic.joint]] + joint.mimic.offset
            if joint.kind is JointType.PRISMATIC:
                p_joint = p_joint + apply(R_joint, joint.axis) * qj[:, None]
            else:
                R_joint = R_joint @ rotation_about(joint.axis, qj)
        R[:, k], p[:, k] = R_joint, p_joint
    return Placements(tree, R, p)
