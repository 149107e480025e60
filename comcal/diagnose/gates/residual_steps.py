# SPDX-License-Identifier: Apache-2.0
"""By how much a reading that repeats itself should have changed between two poses.

Measured minus expected changes by just what the expected reading changed, if the measured one did
not: readings that repeat in a simulation without noise, because nothing changed, do not count.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from comcal.diagnose.gates.channels import Channel
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes import IMU
from comcal.robot.tree import Array
from comcal.statics.torque_rows import motor_torque_factors

CLEAR = 5.0
"""Standard deviations by which a residual must change to show that its reading should have."""
LEVER = 0.1
"""By which errors of forces become errors of moments about P [m]."""
LEAST = 1e-6
"""Errors below are not believed [N], [N m], [rad]."""


@dataclass(frozen=True)
class ResidualSteps:
    """Residuals of a table, by what they are about.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
    """

    assumed: Assumed
    table: PoseTable

    def are_clear(self, channel: Channel, rows: npt.NDArray[np.intp]) -> bool:
        """Return whether the expected reading changed between any neighbours among *rows*."""
        return any(self._step(channel, int(a), int(b)) > CLEAR for a, b in pairwise(rows))

    def _step(self, channel: Channel, a: int, b: int) -> float:
        """Return the change between two poses in standard deviations; NaN where none is known."""
        if channel.name in ("i", "tau"):
            factors = motor_torque_factors(self.assumed.robot)
            scale = float(factors[channel.column]) if channel.name == "i" else 1.0
            sigma = abs(scale) * np.sqrt(2.0 * channel.variance[[a, b]].max())
            return self._over(("torque", channel.target), a, b, sigma)
        if channel.target == IMU:
            sigma = np.sqrt(2.0 * channel.variance[[a, b]].max()) / self.assumed.robot.gravity
            return self._over(("imu", ""), a, b, sigma)
        if channel.name != "q" and self._stands(channel, a) != self._stands(channel, b):
            return np.inf
        standing = channel.name == "q" or self._stands(channel, a)
        key = ("equilibrium", "") if standing else ("sensor", channel.target)
        return self._over(key, a, b, self._wrench_sigma(a, b))

    def _stands(self, channel: Channel, i: int) -> bool:
        row = self._residuals.get(("sensor", channel.target))
        return row is None or not np.isfinite(row[i]).all()

    def _over(self, key: tuple[str, str], a: int, b: int, sigma: Array | float) -> float:
        row = self._residuals.get(key)
        if row is None:
            return np.nan
        return float(np.max(np.abs(row[b] - row[a]) / np.maximum(sigma, LEAST)))

    def _wrench_sigma(self, a: int, b: int) -> Array:
        """Return the error of the sum of two sensors, between two poses, shape (6,)."""
        largest = np.zeros(6)
        for cov in self.table.wrench_cov.values():
            for i in (a, b):
                largest = np.maximum(largest, np.nan_to_num(np.diagonal(cov[i])))
        force, moment = largest[:3].max(), largest[3:].max()
        return 2.0 * np.sqrt(np.repeat([force, moment + LEVER**2 * force], 3))

    @cached_property
    def _residuals(self) -> dict[tuple[str, str], Array]:
        """Return the residuals of every kind and target, shape (N, axes); NaN where absent."""
        found = parity(self.assumed, self.table)
        axes: dict[tuple[str, str], list[str]] = {}
        for row in dict.fromkeys(found.row):
            axes.setdefault((row.kind, row.of), []).append(row.axis)
        table = {key: np.full((len(self.table), len(of)), np.nan) for key, of in axes.items()}
        for value, i, row in zip(found.values, found.pose, found.row, strict=True):
            key = row.kind, row.of
            table[key][i, axes[key].index(row.axis)] = value
        return table
