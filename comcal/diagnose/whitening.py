# SPDX-License-Identifier: Apache-2.0
"""Residuals in units of the noise of their readings, pose by pose.

Readings of different poses err independently, so each pose has a covariance of its own, S V S^T
with the slopes S of its residuals and the covariance V of its readings: one wrong reading shows in
many rows, and the rows are whitened together.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular

from comcal.diagnose.linear import Linear
from comcal.diagnose.readings import layout_of, reading_covariance
from comcal.effects.readings import arrivals
from comcal.robot.healthy import healthy_spreads
from comcal.robot.tree import Array
from comcal.statics.torque_rows import motor_torque_factors

LEAST = {"N": 1e-3, "N m": 1e-4, "rad": 1e-6, "m": 1e-6}
"""Least standard deviation of a residual: readings without a stated error are not exact."""


@dataclass(frozen=True)
class Whitening:
    """How to whiten the rows of every pose.

    Parameters
    ----------
    rows : tuple of array of int
        Numbers of the residuals of each pose that have a value.
    roots : tuple of array
        Lower Cholesky factor of their covariance.
    n : int
        Number of residuals in all.
    """

    rows: tuple[npt.NDArray[np.intp], ...]
    roots: tuple[Array, ...]
    n: int

    @property
    def used(self) -> npt.NDArray[np.intp]:
        """Numbers of the residuals in use, in the order of whitened rows."""
        return np.concatenate(self.rows) if self.rows else np.zeros(0, np.intp)

    @property
    def pose(self) -> npt.NDArray[np.intp]:
        """Number of the pose of every whitened row."""
        return np.repeat(np.arange(len(self.rows)), [len(rows) for rows in self.rows])

    @property
    def slices(self) -> tuple[slice, ...]:
        """Where the rows of each pose stand among the whitened ones."""
        ends = np.cumsum([0, *(len(rows) for rows in self.rows)]).tolist()
        return tuple(slice(a, b) for a, b in itertools.pairwise(ends))

    @property
    def log_det(self) -> float:
        """Half the logarithm of the determinant of all covariances together."""
        return float(sum(np.log(np.diag(root)).sum() for root in self.roots))

    def restricted(self, valid: npt.NDArray[np.bool_]) -> Whitening:
        """Return the whitening of those residuals alone that are valid, a mask of shape (n,)."""
        if all(valid[rows].all() for rows in self.rows):
            return self
        rows: list[npt.NDArray[np.intp]] = []
        roots: list[Array] = []
        for mine, root in zip(self.rows, self.roots, strict=True):
            kept = valid[mine]
            rows.append(mine[kept])
            whole = kept.all()
            roots.append(root if whole else np.linalg.cholesky((root @ root.T)[kept][:, kept]))
        return Whitening(tuple(rows), tuple(roots), self.n)

    def turned(self, columns: Array) -> Array:
        """Whiten residuals (n,) or columns (n, k) of all rows: to (m,) or (m, k)."""
        parts = [
            solve_triangular(root, columns[rows], lower=True, check_finite=False)
            for rows, root in zip(self.rows, self.roots, strict=True)
        ]
        return np.concatenate(parts) if parts else columns[:0]


def whitening(at: Linear, noise: float = 1.0) -> Whitening:
    """Return how the residuals of a state are whitened by the errors of its readings.

    Parameters
    ----------
    at : Linear
    noise : float
        Factor on all stated standard deviations.
    """
    cov = reading_covariance(at.table) * noise**2 + _of_unknown_arrival(at)
    least = np.array([LEAST[row.unit] for row in at.at.row])
    rows: list[npt.NDArray[np.intp]] = []
    roots: list[Array] = []
    for pose in range(len(at.table)):
        mine = np.flatnonzero((at.at.pose == pose) & np.isfinite(at.at.values))
        S = at.slopes[mine]
        part = S @ cov[pose] @ S.T + np.diag(least[mine] ** 2)
        rows.append(mine)
        roots.append(np.linalg.cholesky(part))
    return Whitening(tuple(rows), tuple(roots), len(at.at.values))


def _of_unknown_arrival(at: Linear) -> Array:
    """Return what healthy friction and lag add where nobody knows the side of arrival.

    Elsewhere they are one number for all poses, with the sign of the approach; here each reading
    is off by itself. Shape (N, size, size).
    """
    robot, layout = at.assumed.robot, layout_of(at.table)
    spreads = healthy_spreads(robot)
    unknown = np.isnan(arrivals(at.table)).astype(np.float64)
    factor = motor_torque_factors(robot)
    variance = np.zeros((len(at.table), layout.size))
    variance[:, layout.angles()] = unknown * spreads["hysteresis"] ** 2
    with np.errstate(divide="ignore"):
        current = np.where(factor == 0.0, 0.0, spreads["joint_friction"] / factor)
    variance[:, layout.currents()] = unknown * np.nan_to_num(current) ** 2
    return variance[:, :, None] * np.eye(layout.size)
