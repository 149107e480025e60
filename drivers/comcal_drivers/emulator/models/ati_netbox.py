# SPDX-License-Identifier: Apache-2.0
"""ATI Net box in CAN mode: counts on request, long (32 bits) or short (16 bits).

Source: ATI manual 9620-05-net ft, section 15. One byte to the base identifier: 1 asks for long
data, 2 for short data, 4 makes the present reading zero. Little-endian.
"""

from __future__ import annotations

from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.meters import Hardware

BIAS = 4


def default_hardware() -> Hardware:
    """Return what robot.yaml has to say anyway: the box tells it on its web page only."""
    return Hardware(counts_per_force=1e6, counts_per_torque=1e6)


class AtiNetbox(EmulatedDevice):
    """A box that is polled; which of both lengths it is asked for, the description says."""

    def polled(self, frame: Frame) -> list[Frame]:
        """Tell the three commands of one byte from each other."""
        if frame.data == self.poll_data:
            return list(self.newest)
        if frame.data == bytes([BIAS]):
            self.tare()
        return []
