# SPDX-License-Identifier: Apache-2.0
"""Buses and devices of a robot as its robot.yaml has them, checked and in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from comcal_drivers.devices.description import Device

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BusConfig:
    """A bus as python-can opens it: ``can.Bus(interface=..., channel=..., **options)``."""

    name: str
    interface: str
    channel: str | int
    bitrate: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class _AnyDevice:
    """A device and the part of the robot that it speaks for.

    Parameters
    ----------
    name : str
        Sensor or plate, joint, or IMU link of the robot.
    bus : str
    device : Device
    period : float or None
        Seconds between two samples; with a counter it makes the time.
    timeout : float
        Silence after which the device is stale [s]; default: that of the description.
    apart : float
        The most that the stamps of two parts of a sample may be apart [s]; default: the timeout,
        or half the period of force/torque sensors whose parts nothing but their order tells apart.
        For a device with neither counter nor request, half its period makes sure that no half of
        one sample is taken for that of the next, if the adapter's stamps are that good.
    counter_step : int or None
        Replaces ``join.step`` of the description.
    ignore_status : tuple of int
        Bits of the status word that do not spoil a sample; they are counted and reported.
    ignore_where : str
        ``file:line`` of that list, for the report.
    settings : mapping from str to float
        Values that commands use; the description's defaults are in it.
    start : tuple of str
        Commands before the first sample, in order.
    """

    name: str
    bus: str
    device: Device
    period: float | None = None
    timeout: float = 0.05
    apart: float = 0.05
    counter_step: int | None = None
    ignore_status: tuple[int, ...] = ()
    ignore_where: str = ""
    settings: Mapping[str, float] = field(default_factory=dict[str, float])
    start: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorConfig(_AnyDevice):
    """A force/torque sensor.

    Parameters
    ----------
    matrix : array, shape (6, k) or None
        Replaces the one of the device.
    bias : array, shape (k,) or None
        Raw values at no load, subtracted before the matrix.
    scale : array, shape (k,) or None
        Replaces ``scale`` of the description.
    full_scale : array, shape (k,) or None
    counts_per_force, counts_per_torque : float or None
        Replace what the device would tell.
    signs : array, shape (6,)
        +1 or -1; multiplies the finished wrench, in the sensor frame.
    R_sensor_device : array, shape (3, 3)
        Turns force and moment from the device's axes (right-handed ones, where the description
        turns one of them round) into the sensor frame.
    """

    matrix: Array | None = None
    bias: Array | None = None
    scale: Array | None = None
    full_scale: Array | None = None
    counts_per_force: float | None = None
    counts_per_torque: float | None = None
    signs: Array = field(default_factory=lambda: np.ones(6))
    R_sensor_device: Array = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class JointConfig(_AnyDevice):
    """A drive.

    Parameters
    ----------
    counts_per_turn : float or None
        Counts of the encoder per turn of what it sits on (quadrature included).
    gear : float
        Turns of the motor per turn of the joint; default: that of ``motors`` in robot.yaml, else 1.
    sign : int
        +1 or -1: positive for the drive is positive for the joint. It turns round position and
        torque. The current stays as the drive states it: which way it acts, ``motors.JOINT.sign``
        says.
    zero : float
        Position of the joint where the encoder reads zero [rad].
    rated_current, rated_torque : float or None
        [A], [N m at the motor]; replace what the drive would tell.
    ranges : mapping from str to (low, high)
        Replace the range in ``linear`` of the description: position, current, torque.
    eds, dcf : Path or None
        Description of the drive, where it stands; the layout of its PDOs is read from it.
    sync_period : float or None
        Seconds between two SYNC that this program sends; None where another master does.
    """

    counts_per_turn: float | None = None
    gear: float = 1.0
    sign: int = 1
    zero: float = 0.0
    rated_current: float | None = None
    rated_torque: float | None = None
    ranges: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )
    eds: Path | None = None
    dcf: Path | None = None
    sync_period: float | None = None


@dataclass(frozen=True)
class ImuConfig(_AnyDevice):
    """The IMU; ``R_link_device`` (3, 3) turns its specific force into the frame of its link."""

    R_link_device: Array = field(default_factory=lambda: np.eye(3))


DeviceConfig = SensorConfig | JointConfig | ImuConfig


@dataclass(frozen=True)
class CanConfig:
    """Everything that ``sources.can`` says.

    ``clock`` names the sensor or joint whose samples make the rows of a Block.
    """

    buses: Mapping[str, BusConfig]
    sensors: Mapping[str, SensorConfig]
    joints: Mapping[str, JointConfig]
    imu: ImuConfig | None
    clock: str

    @property
    def every_device(self) -> tuple[DeviceConfig, ...]:
        """All of them: sensors, joints, IMU."""
        imu = () if self.imu is None else (self.imu,)
        return (*self.sensors.values(), *self.joints.values(), *imu)

    def devices(self, bus: str) -> tuple[DeviceConfig, ...]:
        """Return what hangs on *bus*."""
        return tuple(device for device in self.every_device if device.bus == bus)
