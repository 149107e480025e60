# SPDX-License-Identifier: Apache-2.0
"""The readings of a pose as one vector, and how parity residuals follow them.

An effect of a sensor, an encoder or a motor only changes what readings mean; one Jacobian with
respect to readings therefore serves the noise and most of the catalogue.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, parity
from comcal.robot.tree import Array

STEPS = {"q": 1e-6, "current": 1e-3, "torque": 1e-2, "imu": 1e-4, "force": 1e-2, "moment": 1e-3}
"""Steps of the derivatives, per kind of reading; residuals are linear but in angles."""


@dataclass(frozen=True)
class Layout:
    """Where which reading is in the vector of a pose.

    Parameters
    ----------
    joints : int
    sensors : tuple of str
    """

    joints: int
    sensors: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of readings of a pose."""
        return 3 * self.joints + 3 + 6 * len(self.sensors)

    def angles(self) -> slice:
        """Return where the joint positions are."""
        return slice(0, self.joints)

    def currents(self) -> slice:
        """Return where the motor currents are."""
        return slice(self.joints, 2 * self.joints)

    def wrench(self, sensor: str) -> slice:
        """Return where the six channels of a sensor are."""
        first = 3 * self.joints + 3 + 6 * self.sensors.index(sensor)
        return slice(first, first + 6)

    def steps(self) -> Array:
        """Return a step for every reading, shape (size,)."""
        wrench = [STEPS["force"]] * 3 + [STEPS["moment"]] * 3
        kinds = [STEPS[kind] for kind in ("q", "current", "torque") for _ in range(self.joints)]
        return np.array(kinds + [STEPS["imu"]] * 3 + wrench * len(self.sensors))


def layout_of(table: PoseTable) -> Layout:
    """Return the layout of the readings of *table*."""
    return Layout(table.q.shape[1], tuple(table.wrench))


def stacked(table: PoseTable) -> Array:
    """Return all readings, shape (N, size), in the order of :class:`Layout`."""
    return np.column_stack(
        [table.q, table.current, table.torque, table.imu, *table.wrench.values()]
    )


def with_readings(table: PoseTable, values: Array) -> PoseTable:
    """Return *table* with other readings, shape (N, size)."""
    at = layout_of(table)
    n = at.joints
    return replace(
        table,
        q=values[:, :n],
        current=values[:, n : 2 * n],
        torque=values[:, 2 * n : 3 * n],
        imu=values[:, 3 * n : 3 * n + 3],
        wrench={sensor: values[:, at.wrench(sensor)] for sensor in at.sensors},
    )


def reading_covariance(table: PoseTable) -> Array:
    """Return the covariance of the readings of every pose, shape (N, size, size).

    Zero where nothing is stated; readings of different kinds are independent.
    """
    at = layout_of(table)
    found = np.zeros((len(table), at.size, at.size))
    variances = np.column_stack([table.q_cov, table.current_var, table.torque_var, table.imu_var])
    diagonal = np.arange(variances.shape[1])
    found[:, diagonal, diagonal] = np.nan_to_num(variances)
    for sensor in at.sensors:
        part = at.wrench(sensor)
        found[:, part, part] = np.nan_to_num(table.wrench_cov[sensor])
    return found


def reading_slopes(assumed: Assumed, table: PoseTable, at: Parity) -> Array:
    """Return d residual / d reading of its own pose, shape (n, size); zero where there is none.

    One evaluation on as many copies of the table as a pose has readings.
    """
    steps = layout_of(table).steps()
    n, size = len(table), len(steps)
    values = stacked(table)
    present = np.flatnonzero(np.isfinite(values).any(axis=0))
    copies = np.tile(values, (len(present), 1)).reshape(len(present), n, size)
    copies[np.arange(len(present)), :, present] += steps[present, None]
    many = with_readings(
        table.select(np.tile(np.arange(n), len(present))), copies.reshape(-1, size)
    )
    moved = parity(assumed, many)
    ahead = by_copy(moved, n, len(present))
    slopes = np.zeros((len(at.values), size))
    slopes[:, present] = np.nan_to_num((ahead - at.values).T / steps[present])
    return slopes


def by_copy(of: Parity, n: int, copies: int) -> Array:
    """Return the residuals of *copies* tables of *n* poses that stood one after the other.

    Returns
    -------
    array, shape (copies, n_residuals)
        Each in the order of one table by itself.
    """
    order = np.argsort(of.pose // n, kind="stable")
    return of.values[order].reshape(copies, -1)
