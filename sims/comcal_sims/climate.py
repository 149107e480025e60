# SPDX-License-Identifier: Apache-2.0
"""The temperature of the sensors in the course of a session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array

RESOLUTION = 0.01
"""Of the thermometers [K]."""


@dataclass(frozen=True)
class Climate:
    """Sensors warm up after the start, and may be let cool again.

    Parameters
    ----------
    start : float
        Temperature when the session begins [deg C].
    rise : float
        By which they become warmer in the end [K].
    time_constant : float
        [s]; zero: at once.
    cooling_from : float
        Session time from which they cool as they warmed [s]; zero: never.
    first : float
        Session time of the first pose, whose temperature offsets are counted from [s].
    """

    start: float = 24.0
    rise: float = 10.0
    time_constant: float = 900.0
    cooling_from: float = 0.0
    first: float = 0.0

    def temperature(self, t: Array) -> Array:
        """Return what the thermometers say, shape (n,) [deg C]."""
        return np.round(self._true(t) / RESOLUTION) * RESOLUTION

    def warming(self, t: Array) -> Array:
        """Return how much warmer than in the first pose the sensors are, shape (n,) [K]."""
        return self._true(t) - self._true(np.array(self.first))

    @property
    def _constant(self) -> float:
        return max(self.time_constant, 1e-3)

    def _true(self, t: Array) -> Array:
        warm = self._warmed(t)
        if self.cooling_from > 0.0:
            top = self._warmed(np.array(self.cooling_from))
            later = np.maximum(t - self.cooling_from, 0.0)
            warm = np.where(t > self.cooling_from, top * np.exp(-later / self._constant), warm)
        return self.start + warm

    def _warmed(self, t: Array) -> Array:
        return self.rise * (1.0 - np.exp(-t / self._constant))
