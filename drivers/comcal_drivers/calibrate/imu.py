# SPDX-License-Identifier: Apache-2.0
"""From the raw values of an accelerometer to the specific force in its link's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal_drivers.calibrate.calibrated import Array, Calibrated, StatusRule, judge, status_rule
from comcal_drivers.devices.configured import ImuConfig
from comcal_drivers.devices.description import Imu
from comcal_drivers.join.sample import Samples


@dataclass(frozen=True)
class ImuCalibration:
    """``gain``: shape (3, 3), raw to specific force in the link [m/s^2]; ``status``: masks."""

    gain: Array
    status: StatusRule

    def apply(self, samples: Samples) -> Calibrated:
        """Return the specific force, shape (n, 3) [m/s^2]; (0, 0, +9.81) at rest and level."""
        force = np.zeros((len(samples), 3))
        for axis in range(3):
            for channel in range(3):  # as in wrench.py: the same bits in every batch
                force[:, axis] += self.gain[axis, channel] * samples.values[:, channel]
        flags, counts = judge(samples, self.status, np.zeros(len(samples), np.bool_))
        return Calibrated(samples.t, samples.counter, samples.last_row, force, flags, counts)


def imu_calibration(config: ImuConfig) -> ImuCalibration:
    """Return the calibration of an IMU."""
    rule = config.device.description.calibrate.imu or Imu()
    status = status_rule(config.device.description, config.ignore_status)
    return ImuCalibration(config.R_link_device * rule.scale, status)
