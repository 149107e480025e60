# SPDX-License-Identifier: Apache-2.0
"""The order of the frames of several buses: by their stamps, as far as they have come."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.source.series import Integers

KEPT = 1 << 16
"""Frames of a bus whose place is remembered: a sample is known that much later at most."""


class FrameOrder:
    """Running numbers over the frames of all buses.

    Parameters
    ----------
    buses : iterable of str

    Notes
    -----
    With one bus these are its own. Frames of several buses are ordered by stamp among those that
    come in one call; the order between buses then depends on how the stream was cut.
    """

    def __init__(self, buses: tuple[str, ...]) -> None:
        self._buses = buses
        self._own = dict.fromkeys(buses, 0)
        self._all = 0
        self._places = {bus: np.empty(0, np.int64) for bus in buses}

    @property
    def last(self) -> int:
        """Running number of the newest frame of all; -1 before the first."""
        return self._all - 1

    def first_row(self, bus: str) -> int:
        """Return the running number, on its own bus, of the next frame."""
        return self._own[bus]

    def take(self, batches: Mapping[str, FrameBatch]) -> None:
        """Number the frames of all buses that came together."""
        names = [bus for bus in self._buses if bus in batches]
        stamps = [batches[bus].t for bus in names]
        n = sum(len(t) for t in stamps)
        if not n:
            return
        order = np.argsort(np.nan_to_num(np.concatenate(stamps)), kind="stable")
        if len(names) == 1:
            order = np.arange(n)
        rank = np.empty(n, np.int64)
        rank[order] = np.arange(self._all, self._all + n)
        first = 0
        for bus, t in zip(names, stamps, strict=True):
            # Stamps that run back must not turn round the order of one bus.
            mine = np.maximum.accumulate(rank[first : first + len(t)])
            self._places[bus] = np.concatenate([self._places[bus][-KEPT:], mine])
            self._own[bus] += len(t)
            first += len(t)
        self._all += n

    def of(self, bus: str, rows: Integers) -> Integers:
        """Return the running numbers over all buses of frames of one bus."""
        places = self._places[bus]
        oldest = self._own[bus] - len(places)
        return places[np.clip(rows - oldest, 0, len(places) - 1)] if len(places) else rows
