# SPDX-License-Identifier: Apache-2.0
"""JR3 sensor behind the Mbed board of UC3M: three values and a frame counter per frame.

Source: roboticslab-uc3m/jr3-mbed-firmware-can, README.md and main.cpp. Identifiers are
``opcode + id``, but SYNC has none. Every command but that is acknowledged.
"""

from __future__ import annotations

import struct

import numpy as np

from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.meters import Hardware, WrenchMeter

SYNC, ACKNOWLEDGE, START_SYNC, START_ASYNC, STOP = 0x080, 0x100, 0x180, 0x200, 0x280
ZERO, FILTER, STATE, FORCE_SCALES, MOMENT_SCALES, RESET = 0x300, 0x380, 0x400, 0x480, 0x500, 0x580
BOOT = 0x700
READY = b"\0"


def default_hardware() -> Hardware:
    """Return full scales [N], [0.1 N m]."""
    return Hardware(full_scale=np.array([600.0, 600.0, 1200.0, 600.0, 600.0, 600.0]))


class Jr3Uc3m(EmulatedDevice):
    """A board that streams on its own or on every SYNC once it is told which."""

    streams_at_power_up = False
    meter: WrenchMeter
    waits_for_sync: bool = False

    @property
    def follows_sync(self) -> bool:
        """Whether it was started that way."""
        return self.waits_for_sync

    def boot(self) -> list[Frame]:
        """Say that the sensor is ready."""
        return [self._frame(BOOT, b"")]

    def obey(self, frame: Frame) -> list[Frame]:
        """Answer a command; those too short to hold their arguments get the firmware's zeros."""
        if frame.id == SYNC and not frame.data:
            self.was_asked = True
            return list(self.newest) if self.waits_for_sync else []
        opcode = frame.id - self.config.device.ids["id"]
        if opcode not in (
            START_SYNC, START_ASYNC, STOP, ZERO, FILTER, STATE, FORCE_SCALES, MOMENT_SCALES, RESET,
        ):  # fmt: skip
            return []
        more = b""
        if opcode in (START_SYNC, START_ASYNC, STOP, RESET):
            self.streams = opcode == START_ASYNC or (opcode == RESET and self.streams)
            self.waits_for_sync = opcode == START_SYNC
        if opcode == ZERO:
            self.tare()
        elif opcode == RESET:
            self.untare()
        elif opcode in (FORCE_SCALES, MOMENT_SCALES):
            scales = self.meter.actual.full_scale
            first = 0 if opcode == FORCE_SCALES else 3
            values = np.zeros(6) if scales is None else np.rint(scales)
            more = struct.pack("<3H", *values[first : first + 3].astype(int))
        return [self._frame(ACKNOWLEDGE, READY + more)]

    def _frame(self, opcode: int, data: bytes) -> Frame:
        return Frame(opcode + self.config.device.ids["id"], data, device=self.name)
