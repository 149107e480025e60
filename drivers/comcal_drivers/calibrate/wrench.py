# SPDX-License-Identifier: Apache-2.0
"""From the raw values of a force/torque sensor to its wrench.

::

    raw' = (raw - bias) * scale                     (* full scale / divisor)
    w'   = matrix raw'                              (channels to components where there is none)
    w''  = w' * unit * moment factor / counts       (force and moment each)
    w    = signs * R_sensor_device * turned w''     (an axis of left-handed devices is turned round)

All of it but the bias is one 6 x k gain, made once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal_drivers.calibrate.calibrated import Calibrated, StatusRule, judge, status_rule
from comcal_drivers.devices.commands import DeviceValues
from comcal_drivers.devices.configured import SensorConfig
from comcal_drivers.devices.description import AXES, ForceTorque, Levels
from comcal_drivers.join.sample import Samples

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class WrenchCalibration:
    """What turns raw values into a wrench.

    Parameters
    ----------
    gain : array, shape (6, k)
        [N, N m per raw unit]; rows of NaN for components that the device does not measure.
    bias : array, shape (k,)
    levels : Levels or None
        Raw values at or beyond these are saturated.
    status : StatusRule
    """

    gain: Array
    bias: Array
    levels: Levels | None
    status: StatusRule

    def apply(self, samples: Samples) -> Calibrated:
        """Return the wrenches of *samples*, shape (n, 6) [N, N m] in the sensor frame.

        Each is computed by itself: the same sample gives the same bits in every batch.
        """
        raw = samples.values - self.bias
        wrench = np.zeros((len(samples), 6))
        for component in range(6):
            # No matrix product: BLAS sums in an order that depends on the number of samples.
            for channel in range(raw.shape[1]):
                wrench[:, component] += self.gain[component, channel] * raw[:, channel]
        at_limit = np.zeros(len(samples), np.bool_)
        if self.levels is not None:
            low, high = self.levels.low, self.levels.high
            beyond = (samples.values <= low) | (samples.values >= high)
            at_limit = np.logical_or.reduce(beyond, axis=1)
        flags, counts = judge(samples, self.status, at_limit)
        return Calibrated(samples.t, samples.counter, samples.last_row, wrench, flags, counts)


def wrench_calibration(config: SensorConfig, values: DeviceValues) -> WrenchCalibration:
    """Put together what the description, robot.yaml and the device itself say.

    Parameters
    ----------
    config : SensorConfig
    values : mapping
        What the device told (:class:`~comcal_drivers.devices.commands.Listener`); robot.yaml wins.

    Returns
    -------
    WrenchCalibration

    Raises
    ------
    ConfigError
        If something is needed that nobody says; the message names the key of robot.yaml.
    """
    description = config.device.description
    rule = description.calibrate.force_torque or ForceTorque()
    channels = len(description.values)
    scale = np.broadcast_to(rule.scale if config.scale is None else config.scale, (channels,))
    if rule.full_scale is not None:
        full_scale = config.full_scale
        if full_scale is None:
            full_scale = _told(config, values, "full_scale", channels)
        scale = scale * full_scale / rule.full_scale.divisor
    gain = _matrix(config, values, rule, channels) * scale
    gain *= _units(config, values, rule)[:, None]
    if rule.left_handed is not None:
        axis = "xyz".index(rule.left_handed)
        gain[[axis, axis + 3]] *= -1.0
    R = config.R_sensor_device
    if not np.array_equal(R, np.eye(3)):
        gain = np.concatenate([R @ gain[:3], R @ gain[3:]])
    bias = np.zeros(channels) if config.bias is None else config.bias
    status = status_rule(description, config.ignore_status)
    return WrenchCalibration(config.signs[:, None] * gain, bias, rule.saturation, status)


def _matrix(config: SensorConfig, values: DeviceValues, rule: ForceTorque, channels: int) -> Array:
    """Return the matrix, or the one that only puts channels where they belong."""
    if config.matrix is not None:
        return config.matrix.copy()
    if rule.matrix == "device":
        return _told(config, values, "matrix", 6 * channels).reshape(6, channels)
    if rule.matrix == "given":
        raise _unknown(config, "matrix")
    matrix = np.zeros((6, channels))
    for channel, axis in enumerate(rule.channels):
        matrix[AXES.index(axis), channel] = 1.0
    for row in range(0, 6, 3):
        if not matrix[row : row + 3].any():
            matrix[row : row + 3] = np.nan
    return matrix


def _units(config: SensorConfig, values: DeviceValues, rule: ForceTorque) -> Array:
    """Return N or N m per unit of the matrix's result, for each component."""
    units = np.ones(6)
    units[3:] *= rule.moment_factor
    for rows, kind in ((slice(0, 3), "force"), (slice(3, 6), "torque")):
        if rule.counts:
            name = f"counts_per_{kind}"
            given: float | None = getattr(config, name)
            units[rows] /= _told(config, values, name, 1)[0] if given is None else given
        if f"{kind}_unit" in values:
            units[rows] *= _told(config, values, f"{kind}_unit", 1)[0]
    return units


def _told(config: SensorConfig, values: DeviceValues, name: str, size: int) -> Array:
    """Return what the device told, if it did."""
    told = values.get(name)
    if told is None or isinstance(told, str):
        raise _unknown(config, name)
    array = np.atleast_1d(np.array(told, np.float64))
    if array.size != size or not np.isfinite(array).all():
        raise ConfigError(
            f"the device told no usable {name}",
            where=f"sensor {config.name}",
            measured=f"{array.size} numbers",
            limit=f"{size} finite ones",
            next_step=f"start the recording again, or give `{name}` in robot.yaml",
        )
    return array


def _unknown(config: SensorConfig, name: str) -> ConfigError:
    asked = [
        c for c, command in config.device.description.commands.items() if name in command.gives
    ]
    return ConfigError(
        f"nobody says what the {name} of this sensor is",
        where=f"sensor {config.name} ({config.device.description.name})",
        next_step=(
            f"let the device be asked at the start (command {asked[0]!r}), or " if asked else ""
        )
        + f"give `{name}` under sources.can.sensors.{config.name} in robot.yaml",
    )
