# SPDX-License-Identifier: Apache-2.0
"""IIT strain boards of iCub: calibrated values, offset binary, little-endian.

Source: robotology/icub-firmware-shared, iCubCanProto_analogSensorMessages.h. Commands go to
``0x200 | board``, answers come from ``0x200 | board << 4`` and repeat the command.
"""

from __future__ import annotations

import struct

import numpy as np

from comcal.robot.tree import Array
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.meters import Hardware, WrenchMeter

POLLING = 0x200
TX_MODE, PERIOD, TARE, FULL_SCALE, SERIAL, FIRMWARE = 0x07, 0x08, 0x15, 0x18, 0x1A, 0x1C
THERMOMETER_CONFIG, THERMOMETER = 0x39, 0x3A
ON, OFF, RAW, BOTH = 0, 1, 3, 4
"""Modes of transmission; raw values are not emulated, and silence in that mode is honest."""
FORGET, SET = 0, 1
"""What the tare command is told."""


def default_hardware() -> Hardware:
    """Return the full scales of the sensor in the feet of iCub [N, N m]."""
    return Hardware(full_scale=np.array([1500.0, 1500.0, 2000.0, 35.0, 35.0, 25.0]))


class IitStrain(EmulatedDevice):
    """A board that streams once it is told to."""

    streams_at_power_up = False
    meter: WrenchMeter
    period_ms: int = 10
    """As set; the emulated robot sends at the rate of its world whatever it is."""
    thermometer_s: float = 0.0

    @property
    def board(self) -> int:
        """Address, 1 to 15."""
        return self.config.device.ids["board"]

    @property
    def thermometer_period(self) -> float:
        """Seconds between two temperatures; zero until the host asks for them."""
        return self.thermometer_s

    def obey(self, frame: Frame) -> list[Frame]:
        """Answer a command of the polling class."""
        data = frame.data
        if frame.id != POLLING | self.board or not data:
            return []
        command, arguments = data[0], data[1:]
        if command == TX_MODE and arguments:
            self.streams = arguments[0] in (ON, BOTH)
        elif command == PERIOD and arguments:
            self.period_ms = arguments[0]
        elif command == THERMOMETER and arguments:
            self.thermometer_s = float(arguments[0])
            self.revision += 1
        elif command == TARE and arguments:
            self.tare() if arguments[0] == SET else self.untare()
        elif command == FULL_SCALE and arguments and arguments[0] < 6:
            full_scale = self.meter.actual.full_scale
            value = 0 if full_scale is None else round(float(full_scale[arguments[0]]))
            return [self._answer(data[:2] + struct.pack(">H", value))]
        elif command == SERIAL:
            return [self._answer(bytes([SERIAL]) + b"EMU0001")]
        elif command == FIRMWARE:
            return [self._answer(bytes([FIRMWARE, 2, 0, 5]))]
        return []

    def thermometer_columns(self, temperature: Array) -> dict[str, Array]:
        """Say that the first of two thermometers is there."""
        return {**super().thermometer_columns(temperature), "present": np.ones(temperature.size)}

    def limit_bits(self, channel: int, *, high: bool) -> tuple[int, ...]:
        """Return "some channel of this frame", and two bits for the channel itself."""
        part, within = divmod(channel, 3)
        return 8 * part, 8 * part + 2 + 2 * within + high

    def _answer(self, data: bytes) -> Frame:
        return Frame(POLLING | self.board << 4, data, device=self.name)
