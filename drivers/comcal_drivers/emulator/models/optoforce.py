# SPDX-License-Identifier: Apache-2.0
"""OptoForce sensors with the legacy CAN converter: packets with header and checksum.

Source: RCPRG-ros-pkg/optoforce_can, OptoforceSensor.cpp. The configuration is one packet of nine
bytes in two frames, ``AA 00 32 03 speed filter zero`` and the sum of these seven, big-endian; speed
is the period in milliseconds and zero stops the stream; 255 makes the present reading zero.
"""

from __future__ import annotations

from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame

CONFIGURE = 0x101
HEADER = bytes([0xAA, 0x00, 0x32, 0x03])
ZERO, UNZERO = 255, 0


class Optoforce(EmulatedDevice):
    """A sensor that streams from power-up on."""

    received: bytes = b""
    """The first half of a configuration."""
    rejected: int = 0
    """Configurations with a wrong checksum."""

    def obey(self, frame: Frame) -> list[Frame]:
        """Collect the two frames of a configuration, and obey it if its checksum is right."""
        if frame.id != CONFIGURE + self.config.device.ids.get("offset", 0):
            return []
        if frame.data.startswith(HEADER):
            self.received = b""
        self.received += frame.data
        if len(self.received) < 9:
            return []
        packet, self.received = self.received[:9], b""
        if int.from_bytes(packet[7:], "big") != sum(packet[:7]) or packet[:4] != HEADER:
            self.rejected += 1
            return []
        self.streams = packet[4] != 0
        if packet[6] == ZERO:
            self.tare()
        elif packet[6] == UNZERO:
            self.untare()
        return []
