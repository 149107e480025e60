# SPDX-License-Identifier: Apache-2.0
"""Sunrise load cell with board M8123B2: three frames of two floats, started by one byte."""

from __future__ import annotations

from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame

COMMAND, START, STOP = 0x80, b"\x02", b"\x00"


class SunriseM8123(EmulatedDevice):
    """A board that streams between start and stop; no other command is known."""

    streams_at_power_up = False

    def obey(self, frame: Frame) -> list[Frame]:
        """Start or stop."""
        if frame.id == COMMAND and frame.data in (START, STOP):
            self.streams = frame.data == START
        return []
