# SPDX-License-Identifier: Apache-2.0
r"""The statically equivalent serial chain: the CoM of any tree, linear in constant vectors.

Walking the tree link by link, every link origin is its parent's origin plus a vector fixed in the
parent, so the mass-weighted mean of all link CoMs is

.. math:: C_M = \sum_k A_k^* r_k + \sum_j A_{p(j)}^* a_j\,q_j\,\mu_j = B(q)\,R

with one constant vector ``r_k`` per rotating body [m] (Cotton 2008 eq. (3), Cotton 2009 eqs.
(6)-(8)) and one constant number per sliding joint: the share :math:`\mu_j` of the total mass beyond
it [1]. The papers let ``r_k`` vary when a joint slides; written this way R stays constant and can
be identified all the same.

Links joined by fixed or sliding joints share one rotation, so they form one *body* and one set of
columns. Lengths of the links are not needed for ``B(q)``: chains without URDF have one too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.robot.frames import apply, skew
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.tree import Array, JointType, Tree

PARALLEL = 1e-9
"""Axes whose cross product is shorter than this count as parallel."""

_TURNING = (JointType.REVOLUTE, JointType.CONTINUOUS)


@dataclass(frozen=True)
class SescChain:
    """Which columns ``B(q)`` of a tree has.

    Parameters
    ----------
    tree : Tree
    bodies : tuple of int
        Link that leads each body: the root, then the child of every turning joint.
    slides : tuple of int
        Index of every sliding joint.
    basis : array, shape (n_bodies, 3, d)
        Directions along which each ``r_k`` is unknown, in the link frame of the body's leader:
        all three (d = 3), or the two in the plane of motion (d = 2).
    normal : array, shape (3,) or None
        Normal of that plane in the root frame; None in space.
    """

    tree: Tree
    bodies: tuple[int, ...]
    slides: tuple[int, ...]
    basis: Array
    normal: Array | None

    @property
    def size(self) -> int:
        """Number of columns of ``B(q)``."""
        return len(self.bodies) * self.basis.shape[2] + len(self.slides)

    @property
    def root_columns(self) -> slice:
        """Columns of the root body: a constant offset of the CoM."""
        return slice(0, self.basis.shape[2])

    @cached_property
    def turns(self) -> Array:
        """Return how far each body turns about ``normal`` per joint, shape (n_bodies, n_joints).

        Meaningful on a planar chain only, where the angle of a body is the sum over the joints
        between it and the root.
        """
        tree = self.tree
        turns = np.zeros((len(tree.links), len(tree.joint_names)))
        axes = place_links(tree, np.zeros(len(tree.joint_names))).axes()[0]
        for k, joint in enumerate(tree.joints):
            if joint.kind in _TURNING and self.normal is not None:
                column, multiplier, _ = _driver(tree, k)
                sense = float(np.sign(axes[k] @ self.normal))
                turns[tree.descendants[k + 1], column] += sense * multiplier
        return turns[list(self.bodies)]

    @cached_property
    def plane(self) -> Array:
        """Return two directions in the plane and both turned by 90 deg, shape (2, 3, 2).

        In the root frame; meaningful on a planar chain only.
        """
        at_zero = self.basis[0]
        normal = np.zeros(3) if self.normal is None else self.normal
        return np.stack([at_zero, skew(normal) @ at_zero])

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of every entry of R: ``link.direction`` [m], or ``share beyond joint`` [1]."""
        directions = "xyz" if self.normal is None else "uv"
        names = [f"{self.tree.links[k].name}.{d}" for k in self.bodies for d in directions]
        slides = [f"share beyond {self.tree.joints[j].name}" for j in self.slides]
        return (*names, *slides)


def common_axis(tree: Tree) -> Array | None:
    """Return the axis about which every joint of *tree* turns, or None if there is not one.

    Returns
    -------
    axis : array, shape (3,)
        Unit vector in the root frame, along the first turning joint.
    """
    turning = [k for k, joint in enumerate(tree.joints) if joint.kind in _TURNING]
    if not turning:
        return None
    axes = place_links(tree, np.zeros(len(tree.joint_names))).axes()[0, turning]
    parallel = np.linalg.norm(np.cross(axes[0], axes), axis=1) < PARALLEL
    return axes[0] if bool(parallel.all()) else None


def sesc_chain(tree: Tree, *, planar: bool = False) -> SescChain:
    """Lay out the statically equivalent serial chain of a tree.

    Parameters
    ----------
    tree : Tree
    planar : bool
        Two columns per body instead of three (Cotton 2009, section III.B): for a tree whose joints
        all turn about one axis. The CoM component along that axis is then not represented.

    Raises
    ------
    ConfigError
        If *planar* is asked of a tree whose joint axes are not all parallel.
    """
    bodies = (0, *(k for k, joint in enumerate(tree.joints, start=1) if joint.kind in _TURNING))
    slides = tuple(k for k, j in enumerate(tree.joints) if j.kind is JointType.PRISMATIC)
    if not planar:
        return SescChain(tree, bodies, slides, np.tile(np.eye(3), (len(bodies), 1, 1)), None)
    normal = common_axis(tree)
    if normal is None:
        raise ConfigError(
            "the joints do not all turn about one axis, so the chain is not planar",
            where=tree.name,
            next_step="use the spatial chain, or give every joint the same axis",
        )
    at_zero = place_links(tree, np.zeros(len(tree.joint_names))).R[0, list(bodies)]
    plane = _in_plane(normal)
    return SescChain(tree, bodies, slides, np.swapaxes(at_zero, 1, 2) @ plane, normal)


def sesc_matrix(chain: SescChain, q: npt.ArrayLike) -> Array:
    """Return ``B(q)`` of Cotton 2009 eq. (8) for N poses.

    Parameters
    ----------
    chain : SescChain
    q : array, shape (N, n_joints)
        Joint positions [rad] or [m], in the order of ``tree.joint_names``.

    Returns
    -------
    B : array, shape (N, 3, chain.size)
        ``B @ R`` is the CoM in the root frame [m]. Row i belongs to component i, so the row of a
        known component is ``B[:, i]`` (eq. (12)). On a planar chain only components perpendicular
        to ``chain.normal`` have a meaning.
    """
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    if chain.normal is not None and not chain.slides:
        return _planar_matrix(chain, q)
    placed = place_links(chain.tree, q)
    turned = placed.R[:, list(chain.bodies)] @ chain.basis
    columns = np.swapaxes(turned, 1, 2).reshape(len(q), 3, -1)
    if not chain.slides:
        return columns
    along = _slide_directions(chain, placed) * _positions(chain.tree, q)[:, chain.slides, None]
    return np.concatenate([columns, np.swapaxes(along, 1, 2)], axis=2)


def line_rows(B: Array, beta: Array, delta: Array) -> Array:
    r"""Return the rows that a measured line of action of gravity gives.

    With the CoM on x = alpha + beta z, y = gamma + delta z, two rows per pose hold:
    ``(B_x - beta B_z) R = alpha`` and ``(B_y - delta B_z) R = gamma``. They need no height, and on
    level ground (beta = delta = 0) they are the rows of eq. (12).

    Parameters
    ----------
    B : array, shape (N, 3, n)
        In the frame of the line (stance frame P).
    beta, delta : array, shape (N,)
        Slopes of the line [1].

    Returns
    -------
    rows : array, shape (N, 2, n)
    """
    slope = np.stack([beta, delta], axis=1)
    return B[:, :2] - slope[:, :, None] * B[:, 2:3]


def r_from_links(chain: SescChain) -> Array:
    """Return R of a tree whose masses, lengths and link CoMs are known.

    Cotton 2008 eqs. (2)-(3) for any tree: ``r_k`` is what hangs on body k, divided by the total
    mass: its own mass times its CoM, and for each child the mass of everything beyond times the
    vector to that child. (Eq. (5) there holds for a walk along a serial chain only.)

    Returns
    -------
    R : array, shape (chain.size,)
        [m], shares of sliding joints [1].

    Raises
    ------
    ConfigError
        If masses or lengths are unknown (chains without URDF).
    """
    tree = chain.tree
    if not tree.geometry_known or not bool(np.isfinite(tree.masses).all()):
        raise ConfigError(
            "link masses and lengths are not known, so R cannot be computed from them",
            where=tree.name,
            next_step="give a URDF, or identify R from measured CoM components",
        )
    beyond = tree.descendants @ tree.masses / tree.total_mass
    own = tree.masses[:, None] * tree.coms / tree.total_mass
    for k, joint in enumerate(tree.joints, start=1):
        own[tree.parents[k]] += beyond[k] * joint.T_parent_joint[:3, 3]
    leader, R_leader_link = _leaders(tree)
    vectors = np.zeros((len(tree.links), 3))
    np.add.at(vectors, leader, apply(R_leader_link, own))
    in_basis = np.einsum("bij,bi->bj", chain.basis, vectors[list(chain.bodies)])
    return np.concatenate([in_basis.ravel(), beyond[[j + 1 for j in chain.slides]]])


def sesc_jacobian(chain: SescChain, q: npt.ArrayLike, r: Array) -> Array:
    """Return how the CoM moves with the joints, from R alone.

    Every joint moves the part of the chain beyond it: turned about its axis, or shifted along it.
    (Cotton 2008 eq. (9) for any tree; the inner product there must end before ``r_l``.)

    Parameters
    ----------
    chain : SescChain
    q : array, shape (N, n_joints)
    r : array, shape (chain.size,)

    Returns
    -------
    J : array, shape (N, 3, n_joints)
        d CoM / d q in the root frame [m/rad] or [m/m]; joints that follow another one by mimic
        count towards the joint they follow.
    """
    tree = chain.tree
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    placed = place_links(tree, q)
    n_turning = len(chain.bodies) * chain.basis.shape[2]
    vectors = np.einsum("bij,bj->bi", chain.basis, r[:n_turning].reshape(len(chain.bodies), -1))
    terms = apply(placed.R[:, list(chain.bodies)], vectors)
    carriers = list(chain.bodies)
    shares = r[n_turning:]
    directions = _slide_directions(chain, placed)
    if chain.slides:
        slid = directions * (_positions(tree, q)[:, chain.slides] * shares)[..., None]
        terms = np.concatenate([terms, slid], axis=1)
        carriers += [int(tree.parents[j + 1]) for j in chain.slides]
    axes = placed.axes()
    J = np.zeros((len(q), 3, len(tree.joint_names)))
    for k, joint in enumerate(tree.joints):
        if not joint.is_movable:
            continue
        if joint.kind is JointType.PRISMATIC:
            i = chain.slides.index(k)
            motion = directions[:, i] * shares[i]
        else:
            carried = terms[:, tree.descendants[k + 1, carriers]].sum(axis=1)
            motion = np.cross(axes[:, k], carried)
        column, multiplier, _ = _driver(tree, k)
        J[:, :, column] += multiplier * motion
    return J


def _planar_matrix(chain: SescChain, q: Array) -> Array:
    """Return ``B(q)`` of a planar chain from the absolute angle of each body, shape (N, 3, size).

    The same numbers as by placing every link, many times faster: two directions of the root frame
    turned by the angle about the normal.
    """
    angle = (q @ chain.turns.T)[:, None, :, None]
    at_zero, ahead = chain.plane
    columns = np.cos(angle) * at_zero[:, None, :] + np.sin(angle) * ahead[:, None, :]
    return columns.reshape(len(q), 3, -1)


def _in_plane(normal: Array) -> Array:
    """Return two unit vectors spanning the plane, shape (3, 2): coordinate axes where possible."""
    first = np.eye(3)[np.argmin(np.abs(normal))]
    u = first - normal * (normal @ first)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(u, normal)], axis=1)


def _leaders(tree: Tree) -> tuple[npt.NDArray[np.intp], Array]:
    """Return each link's body leader and its constant rotation to the leader's frame."""
    leader = np.arange(len(tree.links))
    rotation = np.tile(np.eye(3), (len(tree.links), 1, 1))
    for k, joint in enumerate(tree.joints, start=1):
        if joint.kind not in _TURNING:
            parent = tree.parents[k]
            leader[k] = leader[parent]
            rotation[k] = rotation[parent] @ joint.T_parent_joint[:3, :3]
    return leader, rotation


def _slide_directions(chain: SescChain, placed: Placements) -> Array:
    """Return the axis of every sliding joint in the root frame, shape (N, n_slides, 3)."""
    return placed.axes()[:, list(chain.slides)]


def _driver(tree: Tree, k: int) -> tuple[int, float, float]:
    """Return column of q, multiplier and offset that give the position of joint *k*."""
    joint = tree.joints[k]
    if joint.mimic is None:
        return tree.joint_names.index(joint.name), 1.0, 0.0
    mimic = joint.mimic
    return tree.joint_names.index(mimic.joint), mimic.multiplier, mimic.offset


def _positions(tree: Tree, q: Array) -> Array:
    """Return the positions of all joints, shape (N, n_joints_with_fixed); fixed ones zero."""
    positions = np.zeros((len(q), len(tree.joints)))
    for k, joint in enumerate(tree.joints):
        if joint.is_movable:
            column, multiplier, offset = _driver(tree, k)
            positions[:, k] = multiplier * q[:, column] + offset
    return positions
