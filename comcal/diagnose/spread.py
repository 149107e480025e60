# SPDX-License-Identifier: Apache-2.0
"""How far residuals of a healthy robot stray: noise of the readings, and healthy tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from comcal.diagnose.candidates import Candidate
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, parity
from comcal.robot.tree import Array

STEPS = {"q": 1e-5, "current": 1e-3, "torque": 1e-2, "imu": 1e-3, "force": 1e-1, "moment": 1e-2}
"""Steps of the derivatives with respect to readings; the residuals are all but linear in them."""


@dataclass(frozen=True)
class Whitened:
    """Residuals and what moves them, in units in which a healthy robot has unit covariance.

    Parameters
    ----------
    used : array of bool, shape (n,)
        Rows that have a value.
    values : array, shape (m,)
    L : array, shape (m, m)
        Lower Cholesky factor of the covariance of the rows in use.
    """

    used: npt.NDArray[np.bool_]
    values: Array
    L: Array

    def turned(self, columns: Array) -> Array:
        """Whiten columns of all rows, shape (n, k) to (m, k)."""
        return np.asarray(np.linalg.solve(self.L, columns[self.used]), np.float64)


def noise_covariance(assumed: Assumed, table: PoseTable, at: Parity) -> Array:
    """Return the covariance of all residuals from the errors of readings, shape (n, n).

    Readings of different poses are independent; within a pose one reading is in many rows.
    """
    n_poses = len(table)
    slopes: list[Array] = []
    variances: list[Array] = []

    def add(moved: PoseTable, back: PoseTable, step: float, variance: Array) -> None:
        ahead, behind = (parity(assumed, t).values for t in (moved, back))
        slopes.append(np.nan_to_num((ahead - behind) / (2.0 * step)))
        variances.append(np.nan_to_num(variance))

    def channel(name: str, values: Array, variance: Array, k: int, step: float) -> None:
        if not np.any(np.nan_to_num(variance[:, k]) > 0.0):
            return
        shift = np.zeros(values.shape[1])
        shift[k] = step
        ahead, behind = values + shift, values - shift
        add(replace(table, **{name: ahead}), replace(table, **{name: behind}), step, variance[:, k])

    for k in range(table.q.shape[1]):
        channel("q", table.q, table.q_cov, k, STEPS["q"])
        channel("current", table.current, table.current_var, k, STEPS["current"])
        channel("torque", table.torque, table.torque_var, k, STEPS["torque"])
    for k in range(3):
        channel("imu", table.imu, table.imu_var, k, STEPS["imu"])
    for sensor, wrench in table.wrench.items():
        roots = _roots(table.wrench_cov[sensor])
        for k in range(6):
            # One standard deviation of every pose along its k-th principal direction at a time.
            moved = {**table.wrench, sensor: wrench + roots[:, :, k]}
            back = {**table.wrench, sensor: wrench - roots[:, :, k]}
            add(replace(table, wrench=moved), replace(table, wrench=back), 1.0, np.ones(n_poses))
    B = np.array(slopes, np.float64) * np.sqrt(np.array(variances, np.float64))[:, at.pose]
    same = at.pose[:, None] == at.pose[None]
    return np.asarray(np.where(same, B.T @ B, 0.0), np.float64)


def _roots(cov: Array) -> Array:
    value, vector = np.linalg.eigh(np.nan_to_num(cov))
    return vector * np.sqrt(np.clip(value, 0.0, None))[:, None, :]


def whiten(at: Parity, noise: Array, healthy: Sequence[tuple[Candidate, Array, Array]]) -> Whitened:
    """Join noise and healthy tolerances, and whiten the residuals with them.

    Parameters
    ----------
    at : Parity
    noise : array, shape (n, n)
    healthy : sequence of (candidate, columns (n, k), one sigma (k,))

    Returns
    -------
    Whitened
        Without rows that have no value or no error.
    """
    cov = noise.copy()
    for _, moved, sigma in healthy:
        root = np.nan_to_num(moved) * sigma
        cov += root @ root.T
    used = np.isfinite(at.values) & (np.diag(cov) > 0.0)
    part = cov[np.ix_(used, used)]
    scale = np.sqrt(np.diag(part))
    # Rows that say the same twice make the matrix singular by rounding alone.
    correlation = part / np.outer(scale, scale) + 1e-10 * np.eye(len(scale))
    L = scale[:, None] * np.linalg.cholesky(correlation)
    return Whitened(used, np.linalg.solve(L, at.values[used]), L)
