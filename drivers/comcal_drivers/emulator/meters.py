# SPDX-License-Identifier: Apache-2.0
"""What a device measures: from SI units back to the numbers that it sends.

This is the inverse of ``calibrate``, written from the descriptions of the devices and not from its
code, so that the one checks the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from comcal.errors import ConfigError
from comcal.measure.source import Block
from comcal.robot.tree import Array
from comcal_drivers.devices.configuration import ImuConfig, JointConfig, SensorConfig
from comcal_drivers.devices.description import AXES, Description, DriveSignal

ROOM = 25.0
"""What a thermometer says where nobody simulates a temperature [deg C]."""
TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Reading:
    """Raw values before rounding.

    Parameters
    ----------
    values : array, shape (n, k)
    temperature : array, shape (n,)
        [deg C]
    """

    values: Array
    temperature: Array


class Meter(Protocol):
    """Turns what is physically there into raw values of one device."""

    def read(self, block: Block) -> Reading:
        """Return the raw values of all samples of a block."""
        ...


@dataclass(frozen=True)
class Hardware:
    """What stands in the memory of a force/torque sensor, and the host has to ask for.

    Parameters
    ----------
    matrix : array, shape (6, k) or None
        Value in counts = matrix @ raw.
    full_scale : array, shape (k,) or None
    counts_per_force, counts_per_torque : float
    """

    matrix: Array | None = None
    full_scale: Array | None = None
    counts_per_force: float = 1e6
    counts_per_torque: float = 1e6


@dataclass(frozen=True)
class WrenchMeter:
    """A force/torque sensor.

    Parameters
    ----------
    config : SensorConfig
        Where it says what the hardware is, the emulated one is that.
    hardware : Hardware
        What it is where robot.yaml does not say.
    """

    config: SensorConfig
    hardware: Hardware

    @property
    def actual(self) -> Hardware:
        """The hardware, as robot.yaml has it where it says so."""
        c, h = self.config, self.hardware
        force = h.counts_per_force if c.counts_per_force is None else c.counts_per_force
        torque = h.counts_per_torque if c.counts_per_torque is None else c.counts_per_torque
        return replace(
            h,
            matrix=h.matrix if c.matrix is None else c.matrix,
            full_scale=h.full_scale if c.full_scale is None else c.full_scale,
            counts_per_force=force,
            counts_per_torque=torque,
        )

    def read(self, block: Block) -> Reading:
        """Return the raw values of this sensor's wrench.

        Raises
        ------
        ConfigError
            If the source does not simulate this sensor.
        """
        name = self.config.name
        if name not in block.wrenches:
            raise ConfigError(
                f"the source does not simulate the sensor {name}",
                where=f"sources.can.sensors.{name}",
                next_step=f"it has: {', '.join(block.wrenches) or 'none'}",
            )
        temperatures = block.temperatures or {}
        room = np.full(block.t.shape, ROOM)
        return Reading(self.raw(block.wrenches[name]), temperatures.get(name, room))

    def raw(self, wrench: Array) -> Array:
        """Return the raw values of wrenches in the sensor's frame.

        Parameters
        ----------
        wrench : array, shape (n, 6)
            Force, moment [N, N m].

        Returns
        -------
        array, shape (n, k)
        """
        config, actual = self.config, self.actual
        rule = config.device.description.calibrate.force_torque
        if rule is None:
            return wrench
        in_device = (wrench / config.signs).reshape(-1, 2, 3) @ config.R_sensor_device
        if rule.left_handed is not None:
            in_device[..., "xyz".index(rule.left_handed)] *= -1.0
        in_device[:, 1] /= rule.moment_factor
        if rule.counts:
            in_device[:, 0] *= actual.counts_per_force
            in_device[:, 1] *= actual.counts_per_torque
        values = in_device.reshape(-1, 6)
        if rule.matrix == "none":
            values = values[:, [AXES.index(axis) for axis in rule.channels]]
        elif actual.matrix is not None:
            values = values @ np.linalg.pinv(actual.matrix).T
        if rule.full_scale is not None and actual.full_scale is not None:
            values = values * rule.full_scale.divisor / actual.full_scale
        scale = np.asarray(rule.scale) if config.scale is None else config.scale
        values = values / scale
        return values if config.bias is None else values + config.bias


@dataclass(frozen=True)
class DriveMeter:
    """A drive: position of its joint, current and torque of its motor.

    Parameters
    ----------
    config : JointConfig
    column : int
        Of the joint in a block.
    rated_current, rated_torque : float
        [A], [N m]
    torque_per_current : float
        Torque of the motor over its current [N m/A], for drives that send a torque.
    """

    config: JointConfig
    column: int
    rated_current: float = 10.0
    rated_torque: float = 1.0
    torque_per_current: float = 1.0

    @property
    def rated(self) -> Mapping[str, float]:
        """Rated values, as robot.yaml has them where it says so."""
        c = self.config
        return {
            "rated_current": c.rated_current or self.rated_current,
            "rated_torque": c.rated_torque or self.rated_torque,
        }

    def read(self, block: Block) -> Reading:
        """Return the raw values of this joint."""
        q = block.q[:, self.column]
        zero = np.zeros_like(q)
        current = zero if block.currents is None else block.currents[:, self.column]
        current = np.nan_to_num(current)
        torque = zero * np.nan if block.torques is None else block.torques[:, self.column]
        torque = np.where(np.isnan(torque), current * self.torque_per_current, torque)
        sign = self.config.sign
        quantities = {
            "position": sign * (q - self.config.zero),
            "current": current,
            "torque": sign * torque,
        }
        description: Description = self.config.device.description
        drive = description.calibrate.drive
        columns = {name: zero for name in description.values}
        if drive is not None:
            for quantity in ("position", "current", "torque"):
                signal: DriveSignal | None = getattr(drive, quantity)
                if signal is not None:
                    columns[signal.signal] = self._raw(quantity, signal, quantities[quantity])
        values = np.column_stack([columns[name] for name in description.values])
        return Reading(values, np.full(q.shape, ROOM))

    def _raw(self, quantity: str, signal: DriveSignal, value: Array) -> Array:
        config = self.config
        if signal.side == "motor":
            value = value * config.gear if quantity == "position" else value
            value = value / config.gear if quantity == "torque" else value
        value = value * self._per_unit(signal.unit) / signal.scale
        if signal.per_mille_of is not None:
            value = value * 1000.0 / self.rated[signal.per_mille_of]
        if signal.linear is not None:
            low, high = config.ranges.get(quantity, (signal.linear.low, signal.linear.high))
            value = (value - low) / (high - low) * ((1 << signal.linear.bits) - 1)
        return value

    def _per_unit(self, unit: str) -> float:
        if unit == "counts":
            return (self.config.counts_per_turn or 1.0) / TURN
        return {"turns": 1.0 / TURN, "deg": 360.0 / TURN}.get(unit, 1.0)


@dataclass(frozen=True)
class ImuMeter:
    """An accelerometer."""

    config: ImuConfig

    def read(self, block: Block) -> Reading:
        """Return the specific force in the device's axes [m/s^2].

        Raises
        ------
        ConfigError
            If the source does not simulate an IMU.
        """
        if block.imu is None:
            raise ConfigError("the source does not simulate an IMU", where="sources.can.imu")
        return Reading(block.imu @ self.config.R_link_device, np.full(block.t.shape, ROOM))
