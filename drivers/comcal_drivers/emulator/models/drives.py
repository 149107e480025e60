# SPDX-License-Identifier: Apache-2.0
"""Drives without CANopen: ODrive, VESC, and motors with the protocol of the MIT mini cheetah."""

from __future__ import annotations

import numpy as np

from comcal.robot.tree import Array
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import REMOTE, Frame
from comcal_drivers.emulator.meters import Reading


class Odrive(EmulatedDevice):
    """An ODrive: cyclic messages, each of which a remote request asks for too.

    Source: odriverobotics/ODrive, docs/can-protocol.rst.
    """

    def obey(self, frame: Frame) -> list[Frame]:
        """Answer a remote request with the newest message of its identifier."""
        if frame.kind != REMOTE:
            return []
        return [newest for newest in self.newest if newest.id == frame.id]


class Vesc(EmulatedDevice):
    """A VESC: cyclic status messages; the position starts again after a turn.

    Source: vedderb/bldc, documentation/comm_can.md.
    """

    TURN = 360.0

    def converted(self, values: Array, reading: Reading) -> tuple[Array, dict[str, Array]]:
        """Return the values with the position within one turn."""
        values, extra = super().converted(values, reading)
        description = self.config.device.description
        drive = description.calibrate.drive
        if drive is not None and drive.position is not None:
            column = description.values.index(drive.position.signal)
            values = values.copy()
            values[:, column] = np.mod(values[:, column], self.TURN / drive.position.scale)
        return values, extra


class MitMotor(EmulatedDevice):
    """A motor that answers the commands of a controller, which is another node on the bus.

    Source: CubeMars AK Series Module Product Manual, MIT power mode.
    """

    AT_REST = 2048.0
    """Zero velocity in twelve bits, as the vendor's code rounds it."""

    def converted(self, values: Array, reading: Reading) -> tuple[Array, dict[str, Array]]:
        """Return the values beside the name of the motor."""
        values, extra = super().converted(values, reading)
        select = self.config.device.description.select
        if select is not None:
            motor = float(self.config.device.ids[select.key])
            extra = {**extra, select.signal: np.full(len(values), motor)}
        return values, {**extra, "velocity": np.full(len(values), self.AT_REST)}
