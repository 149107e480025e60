# SPDX-License-Identifier: Apache-2.0
"""The rows of a session, linearised: what a pose's inputs and the unknowns do to its balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.errors import DataError
from comcal.identify.unknowns import Unknowns
from comcal.measure.table import PoseTable
from comcal.robot.frames import apply, skew
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import (
    Balance,
    balance_at,
    input_jacobian,
    joint_motion,
    moment_regressor,
    residual,
)
from comcal.statics.stance import stance_frame
from comcal.statics.support import (
    Carrier,
    loaded_wrenches,
    measured_supports,
    tare_covariances,
)

SAME_FLOOR = 4.0
"""Force directions closer than this many standard deviations may belong to one floor."""
ROUNDING = 1e-12
"""The same for exact data."""
EXACT = 1e-12
"""Smallest eigenvalue of the rows' correlation matrix that can be inverted: what rounding makes."""


@dataclass(frozen=True)
class Group:
    """The poses of one kind of support: measured inputs and their covariances.

    The inputs of a pose are its loaded wrenches, sensor after sensor, then its joint angles.

    Parameters
    ----------
    rows : tuple of int
        Row numbers in the pose table.
    where : tuple of str
        The same for messages.
    w : array, shape (N, n_sensors, 6)
        Ground on robot, in and about each sensor's frame [N, N m].
    q : array, shape (N, n_joints)
        [rad] or [m]
    cov : array, shape (N, n_inputs, n_inputs)
    tare_cov : array, shape (n_sensors, 6, 6)
        Covariance of each loaded sensor's tare, one error for all poses; not contained in ``cov``.
    below_mass : float
        Mass below the loaded cuts [kg]: part of the robot, not of what is carried.
    """

    carrier: Carrier
    rows: tuple[int, ...]
    where: tuple[str, ...]
    w: Array
    q: Array
    cov: Array
    tare_cov: Array
    below_mass: float

    @property
    def inputs(self) -> Array:
        """What was measured, shape (N, n_inputs)."""
        return np.concatenate([self.w.reshape(len(self.w), -1), self.q], axis=1)

    def split(self, inputs: Array) -> tuple[Array, Array]:
        """Return wrenches and angles of an input array of this group's layout."""
        width = self.w.shape[1] * 6
        return inputs[:, :width].reshape(len(inputs), -1, 6), inputs[:, width:]


def groups_of(robot: Robot, table: PoseTable) -> tuple[Group, ...]:
    """Split a table by support.

    Hanging poses carry no whole-robot rows and are left out, and so are poses without a wrench
    whose CoM is given instead.

    Raises
    ------
    ConfigError, MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known.
    """
    groups: list[Group] = []
    for carrier, index in measured_supports(robot, table):
        rows = tuple(int(i) for i in index)
        part = table.select(index)
        w, w_cov = loaded_wrenches(carrier, part)
        width = 6 * w.shape[1]
        cov = np.zeros((len(rows), width + part.q.shape[1], width + part.q.shape[1]))
        for s in range(w.shape[1]):
            at = slice(6 * s, 6 * s + 6)
            cov[:, at, at] = w_cov[:, s]
        angles = np.arange(width, cov.shape[1])
        cov[:, angles, angles] = part.q_cov
        below = float(robot.tree.masses[~carrier.carried].sum())
        where = tuple(table.where(i) for i in rows)
        tare_cov = tare_covariances(carrier, table)
        groups.append(Group(carrier, rows, where, w, part.q, cov, tare_cov, below))
    return tuple(groups)


@dataclass(frozen=True)
class Linearised:
    """One group's rows at a linearisation point.

    Parameters
    ----------
    misclosure : array, shape (N, 4)
        Residual that remains at the measured inputs, to first order.
    A : array, shape (N, 4, size)
        With respect to the unknowns.
    B : array, shape (N, 4, n_inputs)
        With respect to the inputs.
    W : array, shape (N, 4, 4)
        Inverse covariance of the rows, apart from what tares have in common.
    balance : Balance
        The point of linearisation.
    """

    misclosure: Array
    A: Array
    B: Array
    W: Array
    balance: Balance


def linearise(
    robot: Robot, unknowns: Unknowns, group: Group, theta: Array, inputs: Array
) -> Linearised:
    """Linearise the balance of one group at *theta* and (adjusted) *inputs*.

    Raises
    ------
    DataError
        If the stated errors leave a row, or a sum of rows, of some pose exact.
    """
    w, q = group.split(inputs)
    h = unknowns.moments(theta)
    balance = balance_at(robot, group.carrier, q, w)
    B_w, B_q = input_jacobian(balance, h)
    B = np.concatenate([B_w.reshape(len(w), 4, -1), B_q], axis=2)
    W = _weights(B @ group.cov @ np.swapaxes(B, 1, 2), group)
    at_point = residual(balance, theta[0] - group.below_mass, h)
    misclosure = at_point + np.einsum("nij,nj->ni", B, group.inputs - inputs)
    A = regressor(balance, unknowns, balance.direction)
    return Linearised(misclosure, A, B, W, balance)


def _weights(cov: Array, group: Group) -> Array:
    """Invert the covariance of every pose's rows, shape (N, 4, 4)."""
    sigma = np.sqrt(np.einsum("nii->ni", cov))
    unit = sigma[:, :, None] * sigma[:, None]
    correlation = np.divide(cov, unit, out=np.zeros_like(cov), where=unit > 0.0)
    smallest = np.linalg.eigvalsh(correlation)[:, 0]
    i = int(np.argmin(smallest))
    if not smallest[i] > EXACT:
        raise DataError(
            "the stated errors make a sum of forces and moments exact, which cannot be weighed",
            where=group.where[i],
            measured=f"smallest eigenvalue of the rows' correlation {smallest[i]:.1g}",
            limit=f"{EXACT:g}",
            next_step="check se.* and cov.* of its sensors, and noise in robot.yaml",
        )
    return np.asarray(np.linalg.inv(cov), np.float64)


def structure_of(linear: Linearised, unknowns: Unknowns, group: Group) -> tuple[Array, Array]:
    """Return what the *poses* determine, apart from what noise feigns.

    Returns
    -------
    information : array, shape (size, size)
        A^T W A as it would be if poses on one floor had measured one direction of gravity.
    feigned : array, shape (size, size)
        Expectation of the information that the input errors inside A make up by themselves.
    """
    balance = linear.balance
    A = regressor(balance, unknowns, _steady_directions(balance, group.cov))
    information = np.einsum("nji,njk,nkl->il", A, linear.W, A, optimize=True)
    return information, _feigned_information(balance, unknowns, group.cov, linear.W)


def regressor(balance: Balance, unknowns: Unknowns, direction: Array) -> Array:
    """Return d(residual)/d(theta), shape (N, 4, size), for a given direction of gravity."""
    A = np.zeros((len(balance.F), 4, unknowns.size))
    A[:, 0, 0] = -balance.robot.gravity
    moments = moment_regressor(balance, direction)[:, :, list(unknowns.links)]
    A[:, 1:, 1:] = moments.reshape(len(A), 3, -1)
    return A


def _steady_directions(balance: Balance, cov: Array) -> Array:
    """Average the force direction over poses that may have stood on one floor, shape (N, 3).

    In the stance frame a floor leans the same way in every pose; poses whose directions differ by
    no more than their noise are averaged.
    """
    support = balance.carrier.support
    R_root_P, _ = stance_frame(balance.robot, support, balance.placements)
    in_P = np.einsum("nji,nj->ni", R_root_P, balance.direction)
    force = np.einsum("nsij,nsjk->nik", balance.X[:, :, :3, :], _sensor_roots(balance, cov))
    sigma = np.linalg.norm(force, axis=(1, 2)) / np.linalg.norm(balance.F, axis=1)
    apart = np.linalg.norm(in_P[:, None] - in_P[None], axis=-1)
    same = apart <= SAME_FLOOR * np.hypot(sigma[:, None], sigma[None]) + ROUNDING
    mean = same.astype(np.float64) @ in_P
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    return apply(R_root_P, mean)


def _sensor_roots(balance: Balance, cov: Array) -> Array:
    """Return the standard deviation of each loaded wrench as columns, (N, n_sensors, 6, 6)."""
    n, n_sensors = balance.wrench_each.shape[:2]
    variance = np.einsum("nii->ni", cov)[:, : 6 * n_sensors].reshape(n, n_sensors, 6)
    return np.sqrt(variance)[..., None] * np.eye(6)


def _feigned_information(balance: Balance, unknowns: Unknowns, cov: Array, W: Array) -> Array:
    """Return the sum over poses of E[dA^T W dA] for the input errors inside the regressor."""
    tree, g, f = balance.robot.tree, balance.robot.gravity, balance.direction
    size = np.linalg.norm(balance.F, axis=1)[:, None, None]
    across = (np.eye(3) - f[:, :, None] * f[:, None, :]) / size
    n, n_sensors = balance.wrench_each.shape[:2]
    links = list(unknowns.links)
    R = balance.placements.R[:, links]

    # The direction of gravity is measured: d(f x R) with each component of each wrench ...
    df = np.einsum("nij,nsjk->nski", across, balance.X[:, :, :3, :])
    by_wrench = skew(df).reshape(n, 6 * n_sensors, 1, 3, 3) @ R[:, None]
    # ... and so are the angles: a link turns about every joint on its way to the root.
    motion = joint_motion(tree)
    axis = np.where(motion.prismatic[:, None], 0.0, balance.placements.axes()[:, motion.joint])
    beyond = tree.descendants[motion.joint + 1][:, links].astype(np.float64)
    turn = np.einsum("nmi,mk,mj->njki", axis, beyond, motion.drive)
    by_angle = skew(f)[:, None, None] @ skew(turn) @ R[:, None]

    dA = np.concatenate([by_wrench, by_angle], axis=1)
    dA = g * dA * balance.carrier.carried[links][:, None, None]
    dA = np.moveaxis(dA, 3, 2).reshape(n, dA.shape[1], 3, -1)
    weighted = np.einsum("nij,ncd,ndjk->ncik", W[:, 1:, 1:], cov, dA, optimize=True)
    out = np.zeros((unknowns.size, unknowns.size))
    out[1:, 1:] = np.einsum("ncji,ncjk->ik", dA, weighted, optimize=True)
    return out
