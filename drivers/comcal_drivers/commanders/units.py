# SPDX-License-Identifier: Apache-2.0
"""In which unit a drive takes its profile velocity: asked, compared, never guessed."""

from __future__ import annotations

from comcal.errors import ConfigError, HardwareError
from comcal_drivers.canopen_setup import objects
from comcal_drivers.canopen_setup.sdo import Drive
from comcal_drivers.commanders.options import VelocityUnit

DIMENSION_RPM = 0xA4
UNIT_RPM = 0xB447
"""Bytes 1 and 2 of 0x60A9: revolutions (0xB4) per minute (0x47); byte 3 is a power of ten."""


def velocity_unit(drive: Drive, configured: VelocityUnit | None) -> tuple[VelocityUnit, int]:
    """Return the unit of 0x6081 and the power of ten on it.

    Raises
    ------
    ConfigError
        If neither the drive nor robot.yaml tells.
    HardwareError
        If the two contradict each other.
    """
    told = _told(drive)
    if told is not None and configured is not None and told[0] != configured:
        raise HardwareError(
            f"the drive says that its velocities are in {told[0]}, robot.yaml says {configured}",
            where=str(drive),
            next_step="correct velocity_unit in robot.yaml, or the drive's configuration",
        )
    if told is not None:
        return told
    if configured is None:
        raise ConfigError(
            "the drive does not tell the unit of its velocities",
            where=str(drive),
            next_step="write commanders: {cia402: {velocity_unit: rpm}} (of the motor) or "
            "counts/s into robot.yaml, from the manual of the drive",
        )
    return configured, 0


def _told(drive: Drive) -> tuple[VelocityUnit, int] | None:
    unit = drive.read_optional(objects.VELOCITY_UNIT)
    if unit is not None and (unit >> 8) & 0xFFFF == UNIT_RPM:
        return "rpm", _signed(unit >> 24)
    if drive.read_optional(objects.VELOCITY_DIMENSION) == DIMENSION_RPM:
        return "rpm", _signed(drive.read_optional(objects.VELOCITY_NOTATION) or 0)
    return None


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte
