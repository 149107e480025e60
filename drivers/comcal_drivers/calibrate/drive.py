# SPDX-License-Identifier: Apache-2.0
"""From the signals of a drive to position, current and torque of its joint.

::

    value = raw * scale                              (per mille of rated; spread over a range)
    position = sign * turned to radians / gear + zero
    torque   = sign * value * gear                   (gear only where the signal is the motor's)
    current  = value                                 (its sense is told by motors.JOINT.sign)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from comcal.errors import ConfigError
from comcal_drivers.calibrate.calibrated import Array, Calibrated, StatusRule, judge, status_rule
from comcal_drivers.devices.commands import DeviceValues
from comcal_drivers.devices.configured import JointConfig
from comcal_drivers.devices.description import Drive, DriveSignal
from comcal_drivers.join.sample import Samples

QUANTITIES = ("position", "current", "torque")
"""Columns of the result."""
_UNITS = {"A": 1.0, "N m": 1.0, "rad": 1.0, "deg": math.pi / 180.0, "turns": 2.0 * math.pi}


@dataclass(frozen=True)
class DriveCalibration:
    """What turns the raw vector into position [rad], current [A], torque [N m].

    Parameters
    ----------
    column : tuple of int
        Where each quantity stands in the raw vector; -1 where the drive does not send it.
    gain, offset : array, shape (3,)
    status : StatusRule
    """

    column: tuple[int, ...]
    gain: Array
    offset: Array
    status: StatusRule

    def apply(self, samples: Samples) -> Calibrated:
        """Return position, current and torque, shape (n, 3); NaN where not sent."""
        values = np.full((len(samples), len(QUANTITIES)), np.nan)
        for k, column in enumerate(self.column):
            if column >= 0:
                values[:, k] = samples.values[:, column] * self.gain[k] + self.offset[k]
        flags, counts = judge(samples, self.status, np.zeros(len(samples), np.bool_))
        return Calibrated(samples.t, samples.counter, samples.last_row, values, flags, counts)


def drive_calibration(config: JointConfig, values: DeviceValues) -> DriveCalibration:
    """Put together what the description, robot.yaml and the drive itself say.

    Parameters
    ----------
    config : JointConfig
    values : mapping
        What the drive told: ``rated_current`` [A], ``rated_torque`` [N m]; robot.yaml wins.

    Raises
    ------
    ConfigError
        If something is needed that nobody says; the message names the key of robot.yaml.
    """
    description = config.device.description
    rule = description.calibrate.drive or Drive()
    column, gain, offset = list[int](), np.ones(3), np.zeros(3)
    for k, quantity in enumerate(QUANTITIES):
        signal: DriveSignal | None = getattr(rule, quantity)
        if signal is None:
            column.append(-1)
            continue
        column.append(description.values.index(signal.signal))
        gain[k], offset[k] = _line(config, values, quantity, signal)
    status = status_rule(description, config.ignore_status)
    return DriveCalibration(tuple(column), gain, offset, status)


def _line(
    config: JointConfig, values: DeviceValues, quantity: str, signal: DriveSignal
) -> tuple[float, float]:
    """Return gain and offset of one quantity."""
    gain, offset = 1.0, 0.0
    if signal.linear is not None:
        low, high = config.ranges.get(quantity, (signal.linear.low, signal.linear.high))
        gain, offset = (high - low) / ((1 << signal.linear.bits) - 1), low
    factor = signal.scale * _unit(config, signal)
    if signal.per_mille_of is not None:
        factor *= _rated(config, values, signal.per_mille_of) / 1000.0
    if quantity == "position":
        factor *= config.sign / (config.gear if signal.side == "motor" else 1.0)
    elif quantity == "torque":
        factor *= config.sign * (config.gear if signal.side == "motor" else 1.0)
    return gain * factor, offset * factor + (config.zero if quantity == "position" else 0.0)


def _unit(config: JointConfig, signal: DriveSignal) -> float:
    """Return the SI value of one unit of the signal."""
    if signal.unit != "counts":
        return _UNITS[signal.unit]
    if config.counts_per_turn is None:
        raise ConfigError(
            "nobody says how many counts the encoder has",
            where=f"joint {config.name} ({config.device.description.name})",
            next_step=f"give `counts_per_turn` under sources.can.joints.{config.name}",
        )
    return 2.0 * math.pi / config.counts_per_turn


def _rated(config: JointConfig, values: DeviceValues, name: str) -> float:
    """Return a rated value, from robot.yaml or from the drive."""
    given: float | None = getattr(config, name)
    if given is not None:
        return given
    told = values.get(name)
    number = told[0] if isinstance(told, tuple) and len(told) == 1 else told
    if not isinstance(number, int | float) or not math.isfinite(number):
        raise ConfigError(
            f"nobody says what the {name} of this drive is",
            where=f"joint {config.name} ({config.device.description.name})",
            next_step=f"let the drive be asked at the start, or give `{name}` under "
            f"sources.can.joints.{config.name} in robot.yaml",
        )
    return float(number)
