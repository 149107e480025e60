# SPDX-License-Identifier: Apache-2.0
"""Watches a stream of frames for silence, bus-off and errors."""

from __future__ import annotations

import math

import numpy as np

from comcal_drivers.bus.error_frames import bus_off_rows, is_bus_off_after
from comcal_drivers.frames.batch import ERROR, FrameBatch


class Watch:
    """Counts what comes over one bus. Clocks are passed in.

    Parameters
    ----------
    silence_after : float
        How long nothing may come [s].
    now : float
        Monotonic clock [s].
    """

    def __init__(self, silence_after: float, now: float) -> None:
        self._silence_after = silence_after
        self._heard = now
        self.frames = 0
        self.error_frames = 0
        self.bus_off = False
        self.bus_offs = 0
        self.silences = 0
        self.is_silent = False
        self.last_seen = math.nan

    def see(self, batch: FrameBatch, now: float, clock: float) -> None:
        """Take note of frames, or of their absence.

        Parameters
        ----------
        batch : FrameBatch
            Received frames; may be empty.
        now : float
            Monotonic clock [s].
        clock : float
            Time of day [s since 1970].
        """
        if len(batch):
            errors = int(np.count_nonzero(batch.kinds & ERROR))
            self.error_frames += errors
            self.frames += len(batch) - errors
            if errors:
                self.bus_offs += int(np.count_nonzero(bus_off_rows(batch)))
            if errors or self.bus_off:
                self.bus_off = is_bus_off_after(batch, self.bus_off)
            if errors < len(batch):
                self.restart(now)
                self.last_seen = clock
        if not self.is_silent and now - self._heard > self._silence_after:
            self.is_silent = True
            self.silences += 1

    def restart(self, now: float) -> None:
        """Begin to wait for frames anew, as after the device came back."""
        self._heard = now
        self.is_silent = False
