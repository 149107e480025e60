# SPDX-License-Identifier: Apache-2.0
r"""Total CoM of N poses at once, and its Jacobian, in the frame of the root link.

First moments are carried from the tips to the root: a body hands its parent the mass and first
moment of everything it carries, seen in the parent's frame,

.. math:: (M, s)_{parent} \mathrel{+}= E(q)\,(M, s)_{child}

with E of :mod:`comcal.robot.bodies`. Only vectors move, no rotation is composed: a third of the
work of placing every link. It is the sum :math:`M\,CoM = B(q) R` of the statically equivalent
chain (Cotton 2009, eq. (8)) in Horner's order.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.robot.bodies import Bodies, place_bodies
from comcal.robot.tree import Array, Tree

_BLOCK = 1024
"""Poses worked on together: many enough to hide the cost of a call, few enough for the cache."""


def total_com(tree: Tree, q: npt.ArrayLike) -> Array:
    """Return the CoM of the whole tree for N poses.

    Parameters
    ----------
    tree : Tree
    q : array, shape (N, n_joints)
        Joint positions [rad] or [m], in the order of ``tree.joint_names``.

    Returns
    -------
    com : array, shape (N, 3)
        In the root frame [m]; where the root is in the world is not determined here.

    Raises
    ------
    ConfigError
        If masses or lengths are unknown (chains without URDF), or the tree has no mass.
    """
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    mass = _total_mass(tree)
    com = np.empty((len(q), 3))
    for start in range(0, len(q), _BLOCK):
        block = slice(start, start + _BLOCK)
        np.divide(_carried(tree.bodies, q[block])[0].T, mass, out=com[block])
    return com


def com_jacobian(tree: Tree, q: npt.ArrayLike) -> Array:
    r"""Return how the CoM moves with the joints, for N poses.

    A turning joint moves what it carries by :math:`a \times (s - M o)`, a sliding one by
    :math:`M a`, both divided by the total mass.

    Parameters
    ----------
    tree : Tree
    q : array, shape (N, n_joints)

    Returns
    -------
    J : array, shape (N, 3, n_joints)
        d CoM / d q in the root frame [m/rad] or [m/m]; joints that follow another one by mimic
        count towards the joint they follow. For a floating base with rotation R in the world and
        velocities in its own axes, the columns before these are R and ``-R skew(com)``.

    Raises
    ------
    ConfigError
        As of :func:`total_com`.
    """
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    mass = _total_mass(tree)
    J = np.empty((len(q), 3, len(tree.joint_names)))
    for start in range(0, len(q), _BLOCK):
        block = slice(start, start + _BLOCK)
        J[block] = _jacobian_block(tree.bodies, q[block]).transpose(2, 1, 0) / mass
    return J


def _total_mass(tree: Tree) -> float:
    if not tree.geometry_known or not np.isfinite(tree.total_mass):
        raise ConfigError(
            "link masses and lengths are not known, so the CoM cannot be computed from them",
            where=tree.name,
            next_step="give a URDF, or identify the chain from measured CoM components",
        )
    if tree.total_mass <= 0.0:
        raise ConfigError(
            "the robot has no mass, so it has no CoM",
            where=tree.name,
            measured=f"total mass {tree.total_mass:g} kg",
            limit="above 0",
            next_step="give the links of the URDF an <inertial> with a mass",
        )
    return tree.total_mass


def _carried(bodies: Bodies, q: Array) -> Array:
    """Return the first moment of what each body carries, itself included, (n_bodies, 3, N).

    In the body's own frame, about its own origin [kg m].
    """
    n = len(q)
    sv = bodies.positions(q)
    carried = np.empty((len(bodies), 3, n))
    carried[:] = bodies.carried_constants[:, :, None]
    # (1, x, y, z) of what one body carries, and the same times s and times v.
    work = np.empty((3, 4, n))
    work[0, 0] = 1.0
    for b in range(len(bodies) - 1, 0, -1):
        work[0, 1:] = carried[b]
        np.multiply(sv[b - 1, :, None], work[0], out=work[1:])
        carried[bodies.parents[b]] += bodies.carrying[b - 1] @ work.reshape(12, n)
    return carried


def _jacobian_block(bodies: Bodies, q: Array) -> Array:
    """Return the Jacobian times the total mass, shape (n_joints, 3, N)."""
    carried, placed = _carried(bodies, q)[1:], place_bodies(bodies, q)[1:]
    # Motion of the carried moment in the body's own frame, then along the root's axes.
    motion = bodies.axis_products @ carried
    slides = bodies.slides
    motion[slides] = (bodies.masses_beyond[1:, None] * bodies.axes)[slides, :, None]
    motion *= bodies.multipliers[:, None, None]
    moved = np.einsum("bcin,bcn->bin", placed[:, 1:], motion)
    leads = ~bodies.follows
    J = np.empty((int(leads.sum()), 3, len(q)))
    J[bodies.columns[leads]] = moved[leads]
    for i in np.flatnonzero(bodies.follows):
        J[bodies.columns[i]] += moved[i]
    return J
