# SPDX-License-Identifier: Apache-2.0
"""Packets longer than a frame: they begin at a frame with their header and fill the next frames.

Frames of one identifier keep their order, so the frames of a packet follow one another. A packet
that another header interrupts, whose frames have not the lengths that it needs, or are more than
``timeout`` apart, is dropped. If the end of one packet and the beginning of the next are lost
together, the remains look like a packet; its checksum tells, where there is one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal_drivers.join.events import FRAME_BYTES, Events
from comcal_drivers.join.pairs import Index, Pairs
from comcal_drivers.join.sample import LOST


@dataclass
class Packets:
    """State of the search between two batches: what was dropped since the last packet.

    Parameters
    ----------
    header : tuple of int
        First bytes of a packet.
    length : int
        Bytes of a packet.
    timeout : float
        Seconds between its first and its last frame at most.
    """

    header: tuple[int, ...]
    length: int
    timeout: float
    orphaned: int = 0
    short: int = 0
    duplicated: int = 0
    other: int = 0
    resyncs: int = 0
    begun: bool = False
    found_lost: int = 0
    openers: int = 0
    """Dropped since the last packet: frames that begin with the header."""
    others: int = 0
    """And those that do not."""

    @property
    def parts(self) -> int:
        """Frames of a packet."""
        return -(-self.length // FRAME_BYTES)

    @property
    def lost(self) -> int:
        """Packets known to be missing: begun but not ended, or ended but not begun."""
        ends = -(-self.others // max(1, self.parts - 1))
        return self.found_lost + (max(self.openers, ends) if self.begun else 0)

    def pair(self, events: Events, *, at_end: bool) -> Pairs:
        """Find the packets: see :class:`~comcal_drivers.join.pairs.Pairing`."""
        parts, n = self.parts, len(events)
        h = len(self.header)
        begins = (events.raw[:, :h] == np.array(self.header, np.uint8)).all(axis=1)
        opens = begins & (events.length >= h)
        starts = np.flatnonzero(opens)
        bad = np.zeros(starts.size, np.bool_)
        for k in range(parts):
            inside = starts + k < n
            place = np.minimum(starts + k, n - 1)
            wanted = min(FRAME_BYTES, self.length - k * FRAME_BYTES)
            wrong = events.length[place] < wanted
            wrong |= np.abs(events.t[place] - events.t[starts]) > self.timeout
            if k:
                wrong |= opens[place]
            bad |= wrong & inside
        waiting = ~bad & (starts + parts > n)
        settled = n if at_end or not waiting.any() else int(starts[waiting][0])
        index = starts[~bad & ~waiting][:, None] + np.arange(parts)
        flags = self._count_strays(index, opens[:settled])
        return Pairs(index, flags, np.arange(settled, n, dtype=np.intp))

    def _count_strays(self, index: Index, opens: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
        """Count the frames that belong to no packet; mark the packets that come after them."""
        stray = np.ones(opens.size, np.bool_)
        stray[index.ravel()] = False
        self.orphaned += int(stray.sum())
        found = len(index)
        after = np.searchsorted(index[:, 0], np.flatnonzero(stray))
        openers = np.bincount(after[opens[stray]], minlength=found + 1)
        others = np.bincount(after[~opens[stray]], minlength=found + 1)
        openers[0] += self.openers
        others[0] += self.others
        lost = np.maximum(openers, -(-others // max(1, self.parts - 1)))[:found]
        if found:
            lost[0] *= self.begun
            self.begun = True
        self.found_lost += int(lost.sum())
        self.openers, self.others = int(openers[found]), int(others[found])
        return np.where(lost > 0, LOST, np.uint8(0))
