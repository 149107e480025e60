# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics of N poses at once, in the frame of the root link."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.robot.bodies import place_bodies
from comcal.robot.frames import apply
from comcal.robot.tree import Array, Tree

_BLOCK = 256
"""Poses placed together before they are written pose by pose; both stay in the cache."""


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

    @cached_property
    def _axes(self) -> Array:
        local = np.array([j.axis for j in self.tree.joints]).reshape(-1, 3)
        return apply(self.R[:, 1:], local)

    def axes(self) -> Array:
        """Return the axis of every joint (fixed ones zero) in the root frame, (N, n_joints, 3).

        A joint's axis does not change with its own angle, so the child frame may express it.
        """
        return self._axes


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
    bodies = tree.bodies
    shape = (len(q), len(tree.links))
    R, p = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
    for start in range(0, len(q), _BLOCK):
        block = slice(start, start + _BLOCK)
        placed = place_bodies(bodies, q[block])
        flat = placed.reshape(len(bodies), 4, -1)[bodies.of_link]
        links = (bodies.fixed_steps @ flat).reshape(shape[1], *placed.shape[1:])
        R[block] = links[:, 1:].transpose(3, 0, 2, 1)
        p[block] = links[:, 0].transpose(2, 0, 1)
    return Placements(tree, R, p)
