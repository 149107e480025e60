# SPDX-License-Identifier: Apache-2.0
r"""Joint torques at rest, given the measured loads of the feet, for N poses at once.

What lies beyond a turning joint at o with axis a, and above the cuts of the feet, has mass m and
first moment S about the root origin, and carries the measured loads (F, M) of the feet in it. With
f the direction up, the parent must act on the child about +axis with

.. math:: \tau = a \cdot \left( g\,(S - m\,o) \times f - M + o \times F \right)

and along a sliding joint with :math:`a \cdot (g\,m f - F)`. A mimicking joint works for the joint
that it follows (virtual work). The measured load enters the torque of every joint of that leg, so
one wrench's error is in all of them: their covariance is full.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.plan import NONE
from comcal.robot.frames import cross
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array
from comcal.statics.balance import Balance, first_moments, joint_motion
from comcal.statics.moves import Moves, UpSlopes, loads_beyond
from comcal.statics.support import Carrier


def readable_joints(robot: Robot, carrier: Carrier) -> npt.NDArray[np.bool_]:
    """Return which independent joints' torques follow from what is measured, (n_joints,).

    Not those between a standing foot and its sensor, nor those on the way to a foot whose load is
    measured by a plate alone. Of a floating robot that hangs, only those of limbs without branches:
    a crane may hold it at its trunk.
    """
    tree = robot.tree
    motion = joint_motion(tree)
    beyond = tree.descendants[motion.joint + 1]
    fine = np.ones(len(motion.joint), np.bool_)
    for name in carrier.feet:
        foot = robot.feet[name]
        foot_beyond = beyond[:, tree.link_index[foot.link]]
        if foot.sensor in carrier.sensors:
            cut = carrier.frames[carrier.sensors.index(str(foot.sensor))]
            fine &= foot_beyond == beyond[:, cut]
        else:
            fine &= ~foot_beyond
    if carrier.support == NONE and robot.base is Base.FLOATING:
        fine &= ~_branches(beyond, motion.joint)
    undriven = (motion.drive != 0.0).astype(np.float64).T @ ~fine
    return undriven == 0.0


def _branches(beyond: npt.NDArray[np.bool_], joint: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    """Return beyond which moving joints two others lie that are not beyond one another."""
    inside = beyond[:, joint + 1]  # inside[i, j]: joint j is joint i or lies beyond it
    depth = inside.sum(axis=0)
    longest = np.where(inside, depth, 0).max(axis=1)
    return np.asarray(inside.sum(axis=1) > longest - depth + 1, np.bool_)


@dataclass(frozen=True)
class _Arms:
    """What each moving joint holds: reaction g (S - m o) x . per unit of up, and loads."""

    mass: Array
    first_moment: Array
    lever: Array
    loads: Array


def _arms(balance: Balance, moves: Moves, h: Array, masses: Array | None) -> _Arms:
    tree, g = balance.robot.tree, balance.robot.gravity
    m = (tree.masses if masses is None else masses) * balance.carrier.carried
    mass = moves.beyond @ m
    S = moves.beyond @ first_moments(balance, h, masses)
    arm = S - mass[:, None] * moves.origin
    lever = g * np.where(moves.slides, mass[:, None] * moves.axis, cross(moves.axis, arm))
    return _Arms(mass, S, lever, loads_beyond(balance, moves))


def joint_torques(balance: Balance, moves: Moves, h: Array, masses: Array | None = None) -> Array:
    """Return the torque that each independent joint must hold, shape (N, n_joints) [N m], [N].

    Parameters
    ----------
    balance : Balance
    moves : Moves
        Of the same balance.
    h : array, shape (n_links, 3)
        First moments of the links in their own frames [kg m].
    masses : array, shape (n_links,), optional
        By default the URDF's [kg].

    Notes
    -----
    Of parent on child about (along) +axis. Meaningless for joints that are not
    :func:`readable_joints`.
    """
    arms = _arms(balance, moves, h, masses)
    by_load = np.sum(_load_levers(moves) * arms.loads, axis=-1)
    return (np.sum(arms.lever * balance.direction[:, None], axis=-1) + by_load) @ moves.motion.drive


def _load_levers(moves: Moves) -> Array:
    """Return d(torque)/d(load beyond, about the root), shape (N, M, 6)."""
    by_force = np.where(moves.slides, -moves.axis, cross(moves.axis, moves.origin))
    return np.concatenate([by_force, np.where(moves.slides, 0.0, -moves.axis)], axis=-1)


def torque_regressor(
    balance: Balance, moves: Moves, direction: Array, links: Sequence[int] | None = None
) -> tuple[Array, Array]:
    """Return d(torque)/d(m_k) and d(torque)/d(h_k) for a given direction of gravity.

    Parameters
    ----------
    direction : array, shape (N, 3)
        Unit vector up in the root frame.
    links : sequence of int, optional
        Only these links, in this order.

    Returns
    -------
    by_mass : array, shape (N, n_joints, n_links)
    by_moment : array, shape (N, n_joints, n_links, 3)
        Zero for links not beyond the joint and below the cuts.
    """
    at, g = balance.placements, balance.robot.gravity
    chosen = slice(None) if links is None else list(links)
    counted = (moves.beyond * balance.carrier.carried)[:, chosen]
    along = np.sum(moves.axis * direction[:, None], axis=-1)
    across = np.where(moves.slides, 0.0, cross(direction[:, None], moves.axis))
    by_mass = np.where(
        moves.slides[:, 0, None],
        along[..., None],
        across @ np.swapaxes(at.p[:, chosen], 1, 2)
        - np.sum(across * moves.origin, axis=-1)[..., None],
    )
    by_moment = np.einsum("nji,nkil->njkl", across, at.R[:, chosen], optimize=True)
    drive = moves.motion.drive
    return (
        np.einsum("njk,ji->nik", g * by_mass * counted, drive, optimize=True),
        np.einsum("njkl,ji->nikl", g * by_moment * counted[..., None], drive, optimize=True),
    )


def torque_jacobian(
    balance: Balance, moves: Moves, up: UpSlopes, h: Array, masses: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return the derivatives of :func:`joint_torques` with respect to what was measured.

    Returns
    -------
    by_wrench : array, shape (N, n_joints, n_sensors, 6)
        Each loaded wrench in its own sensor's frame.
    by_joint : array, shape (N, n_joints, n_joints)
    by_up : array, shape (N, n_joints, 3)
    """
    arms = _arms(balance, moves, h, masses)
    drive, f = moves.motion.drive, balance.direction[:, None]
    n, n_joints, n_sensors = len(f), drive.shape[1], len(balance.carrier.sensors)
    lever = drive.T @ arms.lever

    direct = _load_levers(moves)[:, None] @ balance.X * _holds(balance, moves).T[..., None]
    by_wrench = np.swapaxes(drive.T @ direct, 1, 2)
    by_wrench = by_wrench + (lever @ up.by_wrench.reshape(n, 3, 6 * n_sensors)).reshape(
        n, n_joints, n_sensors, 6
    )

    # Joint i beyond joint j moves a part of what j holds; joint i at or before j turns all of it,
    # which is the same as turning gravity the other way, since the loads turn with it.
    moved = balance.robot.gravity * cross(moves.of_moments(arms.mass, arms.first_moment), f)
    loads = moves.of_wrenches(arms.loads)
    force = np.swapaxes(loads[..., :3], 1, 2)
    part = moves.axis @ np.swapaxes(moved - loads[..., 3:], 1, 2)
    part += cross(moves.axis, moves.origin) @ force
    part = np.where(moves.slides, -moves.axis @ force, part)
    turned = -np.where(moves.slides, 0.0, cross(moves.axis, f))
    whole = arms.lever @ np.swapaxes(turned, 1, 2)
    first = moves.motion.joint + 1
    inside = moves.beyond[:, first]  # inside[j, i]: joint i is joint j or lies beyond it
    strictly = inside * (1.0 - np.eye(len(first)))
    by_joint = drive.T @ (part * strictly + whole * inside.T) @ drive
    return by_wrench, by_joint + lever @ up.by_joint, lever @ up.by_up


def _holds(balance: Balance, moves: Moves) -> Array:
    """Return which joint holds which sensor's load, shape (M, n_sensors)."""
    holds = np.zeros((len(moves.beyond), len(balance.carrier.frames)))
    for s, k in enumerate(balance.carrier.frames):
        if k is not None:
            holds[:, s] = moves.beyond[:, k]
    return holds


def motor_torque_factors(robot: Robot) -> Array:
    """Return joint torque per motor current, shape (n_joints,) [N m/A]; NaN without motor."""
    factors = np.full(len(robot.tree.joint_names), np.nan)
    for i, name in enumerate(robot.tree.joint_names):
        if name in robot.motors:
            motor = robot.motors[name]
            factors[i] = motor.torque_constant * motor.gear * motor.sign
    return factors
