# SPDX-License-Identifier: Apache-2.0
"""ATI NETCANOEM board: raw strain gages on request, the matrix to make a wrench of them too.

Source: ATI manual 9610-05-1030-04. Identifiers are ``base << 4 | opcode``; an answer has the
opcode of its request, or of its successors where it takes several frames. Big-endian.
"""

from __future__ import annotations

import struct

import numpy as np

from comcal.robot.tree import Array
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.meters import Hardware, Reading, WrenchMeter

MATRIX, SERIAL, SELECT, COUNTS, UNITS, VOLTAGE, RESET, FIRMWARE = 2, 5, 6, 7, 8, 9, 12, 15
NEWTON, NEWTON_METRE = 2, 3
"""Unit codes."""
SLOTS = 16
GAINS = (1.0, 2.0, 0.5)
"""Of the first calibrations, relative to slot 0; the others are empty."""
BAD_CALIBRATION = 1 << 6
_SERIAL_NUMBER = b"FT12345\0"
_VOLTAGES = (0, 0, 177, 280, 31, -32759)
_RADIUS = 0.03
"""Of the circle on which the three beams stand [m]."""
_FULL_SCALE = 3000.0
"""Force on one beam at which its gages read 2**15 [N]."""


def default_hardware() -> Hardware:
    """Return a transducer of three beams with two gages each, in the numbers that the board has.

    Gages 0, 2, 4 feel the force along the axis, gages 1, 3, 5 the one along the circumference.
    The matrix is rounded to single precision, as the board hands it out.
    """
    gages = np.zeros((6, 6))
    for beam, angle in enumerate(np.deg2rad([0.0, 120.0, 240.0])):
        c, s = np.cos(angle), np.sin(angle)
        gages[2 * beam] = [0.02, 0.01, 1 / 3, 2 * s / 3 / _RADIUS, -2 * c / 3 / _RADIUS, 0.0]
        gages[2 * beam + 1] = [-2 * s / 3, 2 * c / 3, 0.01, 0.0, 0.0, 1 / 3 / _RADIUS]
    counts = 1e6
    matrix = np.linalg.inv(gages * 32768.0 / _FULL_SCALE) * counts
    return Hardware(matrix.astype(np.float32).astype(np.float64), None, counts, counts)


class AtiNetcanoem(EmulatedDevice):
    """A board that is polled for gages; see the module for its source."""

    meter: WrenchMeter
    slot: int = 0
    """Active calibration; 0 again after a reset."""

    @property
    def base(self) -> int:
        """Identifier of opcode 0."""
        return self.config.device.ids["base"] << 4

    @property
    def gain(self) -> float | None:
        """Of the active calibration; None where the slot is empty."""
        if self.meter.config.matrix is not None:
            return 1.0  # robot.yaml knows the matrix, whatever slot it stands in
        return GAINS[self.slot] if self.slot < len(GAINS) else None

    @property
    def matrix(self) -> Array:
        """The active calibration, shape (6, 6)."""
        matrix = self.meter.actual.matrix
        return np.zeros((6, 6)) if matrix is None else matrix / (self.gain or 1.0)

    def converted(self, values: Array, reading: Reading) -> tuple[Array, dict[str, Array]]:
        """Return the gages as amplified for the active calibration, and the status word."""
        gain = self.gain
        status = np.full(len(values), 0.0 if gain is not None else BAD_CALIBRATION)
        return values * (gain or 0.0), {"status": status}

    def obey(self, frame: Frame) -> list[Frame]:
        """Answer an opcode of the manual; requests are told from answers by their length."""
        opcode, data = frame.id - self.base, frame.data
        if opcode == MATRIX and len(data) == 1 and data[0] < 6:
            row = self.matrix[data[0]]
            return [
                self._answer(MATRIX + k, struct.pack(">ff", *row[2 * k : 2 * k + 2]))
                for k in range(3)
            ]
        if opcode == SELECT and len(data) == 1 and data[0] < SLOTS:
            self.slot = data[0]
            self.revision += 1
            return [self._answer(SELECT, bytes([self.slot]))]
        if opcode == VOLTAGE and len(data) == 1 and data[0] < len(_VOLTAGES):
            return [self._answer(VOLTAGE, struct.pack(">h", _VOLTAGES[data[0]]))]
        if data:
            return []
        if opcode == RESET:
            self.slot = 0
            self.revision += 1
            return []
        answers = {
            SERIAL: _SERIAL_NUMBER,
            COUNTS: struct.pack(
                ">II",
                round(self.meter.actual.counts_per_force),
                round(self.meter.actual.counts_per_torque),
            ),
            UNITS: bytes([NEWTON, NEWTON_METRE]),
            FIRMWARE: struct.pack(">BBH", 1, 4, 12),
        }
        return [self._answer(opcode, answers[opcode])] if opcode in answers else []

    def _answer(self, opcode: int, data: bytes) -> Frame:
        return Frame(self.base + opcode, data, device=self.name)
