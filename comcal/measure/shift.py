# SPDX-License-Identifier: Apache-2.0
"""How one error that all poses share moves the readings: a bias that is known with a sigma."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.robot.tree import Array


@dataclass(frozen=True)
class Shift:
    """What one standard deviation of an error does to every reading of N poses.

    Parameters
    ----------
    q : array, shape (N, n_joints)
        [rad] or [m]
    wrench : mapping from sensor name to array, shape (N, 6)
        [N, N m]
    torque, current : array, shape (N, n_joints)
        [N m], [A]
    imu : array, shape (N, 3)
        [m/s^2]
    """

    q: Array
    wrench: Mapping[str, Array]
    torque: Array
    current: Array
    imu: Array

    @property
    def is_none(self) -> bool:
        """Whether no reading moves."""
        parts = (self.q, self.torque, self.current, self.imu, *self.wrench.values())
        return not any(part.any() for part in parts)

    def select(self, index: npt.NDArray[np.intp]) -> Shift:
        """Return the shift of some rows only."""
        return Shift(
            self.q[index],
            {name: w[index] for name, w in self.wrench.items()},
            self.torque[index],
            self.current[index],
            self.imu[index],
        )
