# SPDX-License-Identifier: Apache-2.0
"""What one device measured, in the unit of the robot, on the running order of all frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Series:
    """Consecutive samples of one device.

    Parameters
    ----------
    row : array of int64, shape (n,)
        Running number, among the frames of all buses, of the frame with which the sample was
        known. It never decreases, and orders the samples of different devices.
    t : array, shape (n,)
        Stamp of the first frame of the sample [s]; NaN without stamps.
    counter : array of int64, shape (n,)
        As sent, it wraps; -1 without one.
    values : array, shape (n, k)
        NaN where the device says that the sample cannot be used.
    """

    row: Integers
    t: Array
    counter: Integers
    values: Array

    def __len__(self) -> int:
        return int(self.row.size)

    def __getitem__(self, part: slice) -> Series:
        return Series(self.row[part], self.t[part], self.counter[part], self.values[part])


def no_series(width: int) -> Series:
    """Return no samples of *width* values."""
    nothing = np.empty(0, np.int64)
    return Series(nothing, np.empty(0), nothing, np.empty((0, width)))


def chained(pieces: Iterable[Series], width: int) -> Series:
    """Return *pieces* one after the other."""
    given = [no_series(width), *pieces]
    return Series(
        np.concatenate([piece.row for piece in given]),
        np.concatenate([piece.t for piece in given]),
        np.concatenate([piece.counter for piece in given]),
        np.concatenate([piece.values for piece in given]),
    )
