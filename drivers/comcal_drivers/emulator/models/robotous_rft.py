# SPDX-License-Identifier: Apache-2.0
"""Robotous RFT: packets of sixteen bytes over two frames, big-endian.

Source: Robotous RFT series manual 1.8, section 3. Commands are eight bytes to 0x64; answers repeat
the command in their first byte. While it streams, the sensor obeys only stop and bias.
"""

from __future__ import annotations

from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame

COMMAND, FIRST, SECOND = 0x64, 0x01, 0x02
NAME, SERIAL, FIRMWARE, SET_FILTER, GET_FILTER = 0x01, 0x02, 0x03, 0x08, 0x09
ONE, START, STOP, SET_RATE, GET_RATE, BIAS, OVERLOADS = 0x0A, 0x0B, 0x0C, 0x0F, 0x10, 0x11, 0x12


class RobotousRft(EmulatedDevice):
    """A sensor that is idle until it is started, and forgets that without power."""

    streams_at_power_up = False
    rate: int = 0
    filter: tuple[int, int] = (0, 0)

    @property
    def offset(self) -> int:
        """By which all its identifiers are moved."""
        return self.config.device.ids.get("offset", 0)

    def obey(self, frame: Frame) -> list[Frame]:
        """Answer a command packet."""
        if frame.id != COMMAND + self.offset or len(frame.data) != 8:
            return []
        command, argument = frame.data[0], frame.data[1]
        if command == STOP:
            self.streams = False
        elif command == BIAS:
            self.tare() if argument else self.untare()
        if self.streams:
            return []
        if command == START:
            self.streams = True
        elif command == ONE:
            return [f._replace(data=bytes([ONE]) + f.data[1:]) if f.part == 0 else f
                    for f in self.newest]  # fmt: skip
        elif command in (NAME, SERIAL, FIRMWARE):
            text = {NAME: b"RFT80-6A01", SERIAL: b"EMU00001", FIRMWARE: b"1.0.0"}[command]
            return self._answer(bytes([command]) + text)
        elif command in (SET_FILTER, SET_RATE):
            if command == SET_RATE:
                self.rate = argument
            else:
                self.filter = (argument, frame.data[2])
            return self._answer(bytes([command, 1, 0]))  # done, no error
        elif command == GET_RATE:
            return self._answer(bytes([command, self.rate]))
        elif command == GET_FILTER:
            return self._answer(bytes([command, *self.filter]))
        elif command == OVERLOADS:
            return self._answer(bytes([command]))
        return []

    def limit_bits(self, channel: int, *, high: bool) -> tuple[int, ...]:
        """Return the bit of the overload byte: tz is bit 0, fx bit 5."""
        del high
        return (5 - channel,)

    def _answer(self, packet: bytes) -> list[Frame]:
        packet = packet.ljust(16, b"\0")
        return [
            Frame(FIRST + self.offset, packet[:8], device=self.name),
            Frame(SECOND + self.offset, packet[8:], device=self.name),
        ]
