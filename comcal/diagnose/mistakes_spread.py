# SPDX-License-Identifier: Apache-2.0
"""How far residuals may stray without any mistake of wiring: healthy, or with ordinary faults.

Whatever a fault of some size explains is no mistake. All of them are allowed here at once, about
the readings that the model expects, so that a false reading cannot excuse itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import Catalogue, catalogue
from comcal.diagnose.expected import expected_readings
from comcal.diagnose.linear import Linear
from comcal.diagnose.link_loads import link_loads
from comcal.diagnose.readings import layout_of
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.tree import Array
from comcal.statics.torque_rows import motor_torque_factors

SHARED = (
    "ft_bias",
    "ft_gain",
    "ft_crosstalk",
    "ft_mounting",
    "ft_position",
    "ft_drift",
    "ft_temperature",
    "joint_offset",
    "torque_constant",
    "current_offset",
    "ground_tilt",
    "imu_mounting",
)
"""Effects whose columns cost little; those of bodies are found for all links at once."""
MASS, FIRST_MOMENT, PULL = 5.0, 0.5, 20.0
"""Of something that is fixed to, or pulls at, any link: [kg], [kg m], [N]."""
ANGLE = 0.003
"""Of one pose: springs, play, lag [rad]."""
GIVE = 2e-4
"""The same per torque of the joint [rad/(N m)]."""
FRICTION, LOAD_FRICTION = 1.5e-3, 0.1
"""Of one pose: torque over the robot's weight [m], and over the torque itself."""
FORCE, MOMENT, IMU = 0.3, 0.03, 0.05
"""Of one pose [N], [N m], [m/s^2]."""
SIGMAS = 3.0
"""How many healthy deviations are no reason to look further."""
FITTING = {
    "equilibrium": {"N": 3e-3, "N m": 2e-3},
    "sensor": {"N": 2e-4, "N m": 5e-5},
    "torque": {"N": 1e-4, "N m": 1e-4},
}
"""What lengths and soles of a healthy robot do at most, over its weight [1], [m]."""
CLOSING = {"rad": 0.005, "m": 0.005}
"""The same of closure and IMU [rad], [m]."""
SHARE = 0.03
"""The same of torques, over the usual torque of that joint."""
LEAST = 0.1
"""Of what is healthy in all, what every row may stray by itself."""


@dataclass(frozen=True)
class Ordinary:
    """Residual rows about the readings that are expected.

    Parameters
    ----------
    linear : Linear
        At the expected readings.
    each : array, shape (n, size)
        Slopes, times the error of each reading of a pose with a fault of this pose.
    shared : array, shape (n, p)
        What faults that all poses share do to the rows, at their size.
    calm : array, shape (n,)
        Deviation up to which a row says nothing.
    """

    linear: Linear
    each: Array
    shared: Array
    calm: Array

    def apart(self, residuals: Array, most: int, price: float) -> tuple[float, int]:
        """Return chi2 of one set of residuals but for the poses that are furthest off.

        Parameters
        ----------
        residuals : array, shape (n,)
            NaN: left out.
        most : int
            Poses that may be set apart.
        price : float
            By how much a pose must lower chi2 for that.

        Returns
        -------
        chi2 : float
        number : int
            Of poses that were set apart.
        """
        used = np.flatnonzero(np.isfinite(residuals))
        pose, r = self.linear.at.pose[used], residuals[used]
        cov = self.shared[used] @ self.shared[used].T
        for i in np.unique(pose):
            mine = pose == i
            each = self.each[used[mine]]
            cov[np.ix_(mine, mine)] += each @ each.T
        cov[np.diag_indices_from(cov)] += (LEAST * self.calm[used]) ** 2
        P = np.linalg.inv(cov)
        apart = 0
        while True:
            v = P @ r
            gains = {
                i: float(v[mine] @ np.linalg.solve(P[np.ix_(mine, mine)], v[mine]))
                for i in np.unique(pose).tolist()
                for mine in [pose == i]
            }
            worst = max(gains, key=gains.__getitem__, default=None)
            if worst is None or apart >= most or gains[worst] < price:
                return float(r @ v), apart
            mine = pose == worst
            rest, taken = ~mine, np.linalg.solve(P[np.ix_(mine, mine)], P[mine][:, ~mine])
            P = P[np.ix_(rest, rest)] - P[np.ix_(rest, mine)] @ taken
            pose, r, apart = pose[rest], r[rest], apart + 1

    def distances(self, residuals: Array) -> Array:
        """Return chi2 of several sets of residuals, shape (n, k) to (k,).

        Rows that are NaN in the first set are left out of all.
        """
        used = np.isfinite(residuals[:, 0])
        T = self.shared.shape[1]
        both = np.column_stack([self.shared, np.nan_to_num(residuals)])
        pose = self.linear.at.pose
        parts: list[Array] = []
        for i in np.unique(pose[used]):
            mine = np.flatnonzero(used & (pose == i))
            cov = self.each[mine] @ self.each[mine].T + np.diag((LEAST * self.calm[mine]) ** 2)
            parts.append(solve_triangular(np.linalg.cholesky(cov), both[mine], lower=True))
        if not parts:
            return np.zeros(residuals.shape[1])
        white = np.concatenate(parts)
        columns, left = white[:, :T], white[:, T:]
        M = np.eye(T) + columns.T @ columns
        excused = solve_triangular(np.linalg.cholesky(M), columns.T @ left, lower=True)
        return (left**2).sum(axis=0) - (excused**2).sum(axis=0)


def ordinary(assumed: Assumed, table: PoseTable) -> Ordinary:
    """Return how far residuals stray about the readings expected in the poses of *table*.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
        Joint positions count, and which way is up where the robot hangs.
    """
    linear = Linear(assumed, expected_readings(assumed, table))
    of, rows = _catalogue(linear), len(linear.at.values)
    T = of.columns(linear)
    errors, healthy_errors = _errors(assumed, linear.table)
    each = linear.slopes * errors[linear.at.pose]
    loads = link_loads(assumed, linear.table, linear.at)
    bodies = loads.by_weight * np.array([MASS, FIRST_MOMENT, FIRST_MOMENT, FIRST_MOMENT])
    pulls = PULL * loads.by_force
    shared = np.column_stack([T * of.fault, bodies.reshape(rows, -1), pulls.reshape(rows, -1)])

    tree, tolerances = assumed.robot.tree, assumed.robot.tolerances
    masses = tree.masses[:, None] * [tolerances.link_mass, *[tolerances.link_com] * 3]
    healthy = [
        linear.slopes * healthy_errors[linear.at.pose],
        T * of.healthy,
        (loads.by_weight * masses).reshape(rows, -1),
    ]
    sigma = np.sqrt((np.column_stack(healthy) ** 2).sum(axis=1))
    return Ordinary(linear, each, shared, np.hypot(SIGMAS * sigma, _of_fitting(assumed, linear)))


def _catalogue(linear: Linear) -> Catalogue:
    robot = linear.assumed.robot
    return catalogue([c for c in candidates(robot, linear.table) if c.effect.name in SHARED], robot)


def _errors(assumed: Assumed, expected: PoseTable) -> tuple[Array, Array]:
    """Return errors of the readings of a pose, with faults and without, shape (N, size) each.

    Those stated in the table could be in the unit that is wrong: they are not asked.
    """
    robot, noise = assumed.robot, assumed.robot.noise
    layout, n = layout_of(expected), expected.q.shape[1]
    weight = robot.tree.total_mass * robot.gravity
    factors = np.nan_to_num(np.abs(motor_torque_factors(robot)), nan=1.0)
    torque = np.nan_to_num(
        np.where(np.isfinite(expected.torque), expected.torque, expected.current * factors)
    )
    stuck = FRICTION * weight + LOAD_FRICTION * np.abs(torque)
    loose, healthy = np.zeros((2, len(expected), layout.size))

    def stated(family: str) -> float:
        return float(np.hypot(getattr(noise, family), noise.revisit.get(family, 0.0)))

    healthy[:, :n] = stated("encoder")
    healthy[:, n : 2 * n] = stated("current")
    healthy[:, 2 * n : 3 * n] = stated("torque")
    healthy[:, 3 * n : 3 * n + 3] = stated("imu")
    loose[:, :n] = ANGLE + GIVE * np.abs(torque)
    loose[:, n : 2 * n] = stuck / factors
    loose[:, 2 * n : 3 * n] = stuck
    loose[:, 3 * n : 3 * n + 3] = IMU
    for sensor in layout.sensors:
        part = layout.wrench(sensor)
        healthy[:, part] = np.repeat([stated("ft_force"), stated("ft_moment")], 3)
        loose[:, part] = np.repeat([FORCE, MOMENT], 3)
    return np.hypot(loose, healthy), healthy


def _of_fitting(assumed: Assumed, linear: Linear) -> Array:
    """Return how far lengths and soles of a healthy robot move the rows at most, shape (n,)."""
    robot, table = assumed.robot, linear.table
    weight = robot.tree.total_mass * robot.gravity
    by_current = table.current * motor_torque_factors(robot)
    torque = np.where(np.isfinite(table.torque), table.torque, by_current)
    usual = np.sqrt(np.mean(np.nan_to_num(torque) ** 2, axis=0))
    share = dict(zip(robot.tree.joint_names, SHARE * usual, strict=True))
    return np.array(
        [
            CLOSING[row.unit]
            if row.kind not in FITTING
            else FITTING[row.kind][row.unit] * weight + share.get(row.of, 0.0)
            for row in linear.at.row
        ]
    )
