# SPDX-License-Identifier: Apache-2.0
"""What every way of pairing takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from comcal_drivers.join.events import Events

Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Pairs:
    """Which events are samples.

    Parameters
    ----------
    index : array, shape (n, parts)
        Places of the parts of each sample among the events that were given.
    flags : array of uint8, shape (n,)
        Marks of each sample.
    keep : array, shape (m,)
        Places of the events that are not settled, increasing: they must be given again in front of
        the next ones.
    """

    index: Index
    flags: npt.NDArray[np.uint8]
    keep: Index


class Pairing(Protocol):
    """A way of bringing parts together, with its state and its counts.

    The counts are those of :class:`~comcal_drivers.join.sample.Counts`.
    """

    orphaned: int
    short: int
    duplicated: int
    other: int
    resyncs: int

    @property
    def lost(self) -> int:
        """Samples known to be missing."""
        ...

    def pair(self, events: Events, *, at_end: bool) -> Pairs:
        """Find the samples among *events*.

        Parameters
        ----------
        events : Events
            What the last call kept, then new ones.
        at_end : bool
            Nothing comes after them.
        """
        ...


@dataclass
class Single:
    """Every frame is a sample."""

    orphaned: int = 0
    short: int = 0
    duplicated: int = 0
    other: int = 0
    resyncs: int = 0
    lost: int = 0

    def pair(self, events: Events, *, at_end: bool) -> Pairs:
        """Take every part; requests are counted and left out."""
        del at_end
        parts = np.flatnonzero(events.code >= 0)
        self.other += len(events) - parts.size
        return Pairs(parts[:, None], np.zeros(parts.size, np.uint8), np.empty(0, np.intp))
