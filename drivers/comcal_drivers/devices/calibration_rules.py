# SPDX-License-Identifier: Apache-2.0
"""How a device file says what raw values mean."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from comcal_drivers.devices.section import Section

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of a wrench, in order."""
Axis = Literal["fx", "fy", "fz", "tx", "ty", "tz"]


class Levels(Section):
    """Raw values at or beyond these are saturated."""

    low: float
    high: float


class FullScale(Section):
    """Value = raw * full scale / divisor; the full scales of the channels are asked or given."""

    divisor: float = Field(gt=0.0)


class ForceTorque(Section):
    """From raw values to a wrench in the sensor's frame [N, N m]: see ``calibrate/wrench.py``."""

    matrix: Literal["none", "device", "given"] = "none"
    """``device``: read out by the command that gives ``matrix``; ``given``: in robot.yaml."""
    channels: tuple[Axis, ...] = AXES
    """What the values are, in order, where there is no matrix."""
    scale: float | tuple[float, ...] = 1.0
    full_scale: FullScale | None = None
    counts: bool = False
    """Whether the result is divided by ``counts_per_force`` and ``counts_per_torque``."""
    moment_factor: float = 1.0
    """N m per unit of the moments."""
    left_handed: Literal["x", "y", "z"] | None = None
    """Axis to turn round where the device's axes are left-handed: its force and its moment change
    sign, the moments being those of the right-hand rule about each arrow."""
    saturation: Levels | None = None


class Linear(Section):
    """An integer of ``bits`` bits that stands for ``low`` to ``high``."""

    low: float
    high: float
    bits: int = Field(gt=1, le=32)


class DriveSignal(Section):
    """A quantity of a drive.

    ``value = raw * scale``; with ``per_mille_of`` also ``* rated / 1000``, the rated value being
    asked of the drive or given in robot.yaml; with ``linear`` the raw integer is spread first.
    """

    signal: str
    unit: Literal["A", "N m", "rad", "deg", "turns", "counts"]
    scale: float = 1.0
    per_mille_of: Literal["rated_current", "rated_torque"] | None = None
    linear: Linear | None = None
    side: Literal["motor", "joint"] = "motor"
    """``motor``: in front of the gear; positions are divided, torques multiplied by it."""


class Drive(Section):
    """From the signals of a drive to position [rad], current [A] and torque [N m] of a joint."""

    position: DriveSignal | None = None
    current: DriveSignal | None = None
    torque: DriveSignal | None = None


class Imu(Section):
    """From raw values to the specific force along x, y, z of the device [m/s^2]."""

    scale: float = 1.0


class Calibrate(Section):
    """One of them, by kind."""

    force_torque: ForceTorque | None = None
    drive: Drive | None = None
    imu: Imu | None = None
