# SPDX-License-Identifier: Apache-2.0
"""alpha, beta, gamma, delta: the line on which the CoM lies, seen in the stance frame P."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import NotBalancedError
from comcal.measure.table import PoseTable
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.configurations import placed_in_stance
from comcal.statics.joint_slopes import joint_slopes
from comcal.statics.support import (
    Carrier,
    loaded_wrenches,
    measured_supports,
    tare_covariances,
)
from comcal.statics.wrenches import wrench_transform

MIN_VERTICAL_FORCE = 5.0
"""Below this load along the sole normal the CoP has no meaning [N]."""


@dataclass(frozen=True)
class BalanceCoefficients:
    """X = alpha + beta Z, Y = gamma + delta Z: the line of action of gravity in P, pose by pose.

    Speaks of what the sensors *carry*, everything above the loaded cuts.

    Parameters
    ----------
    rows : tuple of int
        Row numbers in the pose table; poses that hang or have no wrench have no coefficients.
    values : array, shape (N, 4)
        alpha [m], beta [1], gamma [m], delta [1].
    cov : array, shape (N, 4, 4)
        From wrench, tare and encoder errors, and what all poses share.
    mass, mass_sigma : array, shape (N,)
        Carried mass |F|/g [kg].
    """

    rows: tuple[int, ...]
    values: Array
    cov: Array
    mass: Array
    mass_sigma: Array

    @property
    def sigma(self) -> Array:
        """Standard deviations, shape (N, 4)."""
        return np.sqrt(np.einsum("nii->ni", self.cov))


def total_wrench(carrier: Carrier, at: Placements, w: Array) -> Array:
    """Return the wrench of the ground on the carried links, about P, in P, shape (N, 6).

    Parameters
    ----------
    at : Placements
        Of N poses, seen from P.
    w : array, shape (N, n_sensors, 6)
        Ground on robot, in and about each loaded sensor's frame.
    """
    return np.einsum("nsij,nsj->ni", to_stance(carrier, at), w)


def to_stance(carrier: Carrier, at: Placements) -> Array:
    """Return the matrices that take each loaded wrench to P, shape (N, n_sensors, 6, 6)."""
    n = len(at.p)
    identity = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    frames = [identity if k is None else (at.R[:, k], at.p[:, k]) for k in carrier.frames]
    return np.stack([wrench_transform(R, p) for R, p in frames], axis=1)


def coefficients_from_wrench(w_P: Array) -> Array:
    """Return alpha, beta, gamma, delta of wrenches about P, shape (..., 4).

    Notes
    -----
    Equations (10)-(13) of Muscolo 2017 without :math:`M_2`: internal torques cancel in the balance
    of the whole robot. That term is the effect ``internal_torque_term`` here.

    Examples
    --------
    180 N, acting 20 mm ahead of and 10 mm to the left of P:

    >>> coefficients_from_wrench(np.array([0, 0, 180.0, 1.8, -3.6, 0])).round(6).tolist()
    [0.02, 0.0, 0.01, 0.0]
    """
    Fx, Fy, Fz, Mx, My, _ = np.moveaxis(w_P, -1, 0)
    return np.stack([-My / Fz, Fx / Fz, Mx / Fz, Fy / Fz], axis=-1)


def coefficients_jacobian(w_P: Array) -> Array:
    """Return the derivative of :func:`coefficients_from_wrench`, shape (..., 4, 6)."""
    values = coefficients_from_wrench(w_P)
    J = np.zeros((*w_P.shape[:-1], 4, 6))
    J[..., 0, 4], J[..., 1, 0], J[..., 2, 3], J[..., 3, 1] = -1.0, 1.0, 1.0, 1.0
    J[..., 2] = -values
    return J / w_P[..., 2, None, None]


def balance_coefficients(robot: Robot, table: PoseTable) -> BalanceCoefficients:
    """Reduce every standing pose of *table* to the line on which its centre of mass lies.

    Raises
    ------
    NotBalancedError
        If the loaded feet together carry less than ``MIN_VERTICAL_FORCE``.
    MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known.

    Notes
    -----
    On level ground beta and delta are zero and one pose says nothing about the height of the CoM.
    """
    n = len(table)
    values, cov = np.full((n, 4), np.nan), np.full((n, 4, 4), np.nan)
    mass, mass_sigma = np.full(n, np.nan), np.full(n, np.nan)
    for carrier, rows in measured_supports(robot, table):
        part = table.select(rows)
        w, w_cov = loaded_wrenches(carrier, part)
        w_cov = w_cov + tare_covariances(carrier, table)
        at = placed_in_stance(robot, carrier, part.q)
        w_P = total_wrench(carrier, at, w)
        _refuse_unloaded(table, rows, w_P)
        X, D = to_stance(carrier, at), _angle_jacobian(robot, carrier, part.q, w)
        w_P_cov = np.einsum("nsij,nsjk,nslk->nil", X, w_cov, X, optimize=True)
        w_P_cov += np.einsum("nij,nj,nkj->nik", D, part.q_cov, D)
        for shift in part.shared.values():
            moved = np.stack([shift.wrench[s] for s in carrier.sensors], axis=1)
            root = np.einsum("nsij,nsj->ni", X, moved) + np.einsum("nij,nj->ni", D, shift.q)
            w_P_cov += root[:, :, None] * root[:, None]
        J = coefficients_jacobian(w_P)
        values[rows] = coefficients_from_wrench(w_P)
        cov[rows] = J @ w_P_cov @ np.swapaxes(J, 1, 2)
        force = np.linalg.norm(w_P[:, :3], axis=1)
        up = w_P[:, :3] / force[:, None]
        mass[rows] = force / robot.gravity
        variance = np.einsum("ni,nij,nj->n", up, w_P_cov[:, :3, :3], up)
        mass_sigma[rows] = np.sqrt(variance) / robot.gravity
    rows = np.flatnonzero(np.isfinite(mass))
    return BalanceCoefficients(
        tuple(int(i) for i in rows), values[rows], cov[rows], mass[rows], mass_sigma[rows]
    )


def _angle_jacobian(robot: Robot, carrier: Carrier, q: Array, w: Array) -> Array:
    """Return d(wrench about P)/dq, shape (N, 6, n_joints).

    The angles move the sensors against one another and P with them.
    """

    def total(moved: Array) -> Array:
        at = placed_in_stance(robot, carrier, moved)
        return total_wrench(carrier, at, np.tile(w, (len(moved) // len(q), 1, 1)))

    return joint_slopes(total, q)


def _refuse_unloaded(table: PoseTable, rows: npt.NDArray[np.intp], w_P: Array) -> None:
    for i, Fz in zip(rows, w_P[:, 2], strict=True):
        if not Fz >= MIN_VERTICAL_FORCE:
            raise NotBalancedError(
                "the standing feet are not loaded",
                where=table.where(int(i)),
                measured=f"{Fz:.1f} N along the sole normal",
                limit=f"{MIN_VERTICAL_FORCE:g} N",
                next_step="check 'support' of this pose and 'sense' of the sensors",
            )
