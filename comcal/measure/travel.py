# SPDX-License-Identifier: Apache-2.0
"""From which side each joint came last, as its encoder saw it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.robot.tree import Array

REVERSAL = 2e-3
"""A joint has turned round when it came back by more than this [rad] or [m]: four times the noise
of a good encoder, less than the play of a good gear."""

PARTS = 4
"""Means taken of a block: shorter excursions are noise."""

Sides = npt.NDArray[np.int64]


class Travel:
    """Follows joints and remembers the direction in which each one travelled last.

    Parameters
    ----------
    n_joints : int
    reversal : float
        Smallest way that counts [rad] or [m].
    """

    def __init__(self, n_joints: int, reversal: float = REVERSAL) -> None:
        self._reversal = reversal
        self._side: Sides = np.zeros(n_joints, np.int64)
        self._low = self._high = self._last = np.full(n_joints, np.nan)

    @property
    def sides(self) -> Sides:
        """Return +1 for joints that travelled upwards last, -1 downwards, 0 not at all, (n,)."""
        return self._side.copy()

    def begin(self) -> None:
        """Forget the past: sides count from where the joints were seen last.

        What moves between two readings, such as an emulated robot, has come from there too.
        """
        self._side = np.zeros_like(self._side)
        self._low = self._high = self._last

    def follow(self, q: Array) -> None:
        """Take the next samples.

        Parameters
        ----------
        q : array, shape (n, n_joints)
            [rad] or [m]; samples that are not finite are left out.
        """
        for part in np.array_split(q, min(PARTS, len(q))) if len(q) else ():
            whole = part[np.isfinite(part).all(axis=1)]
            if len(whole):
                self._step(whole.mean(axis=0))

    def _step(self, x: Array) -> None:
        self._last = x
        low, high = np.fmin(self._low, x), np.fmax(self._high, x)
        up = (self._side != 1) & (x > low + self._reversal)
        down = (self._side != -1) & (x < high - self._reversal)
        self._side = np.where(up, 1, np.where(down, -1, self._side))
        # An extreme that the joint has left behind no longer counts.
        self._low = np.where(self._side == 1, x, low)
        self._high = np.where(self._side == -1, x, high)
