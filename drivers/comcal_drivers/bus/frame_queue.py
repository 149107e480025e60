# SPDX-License-Identifier: Apache-2.0
"""A queue of frames between two threads: bounded, in order, and honest about what it dropped."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass

from comcal_drivers.bus.error_frames import gap_marker
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate, take

MOST_BATCHES = 1024
"""Batches that are kept apart; more are joined to one, which needs a fraction of the memory."""


@dataclass(eq=False)
class Slot:
    """A place in the queue, kept for frames that may yet come to nothing."""

    batch: FrameBatch
    is_settled: bool = True


class FrameQueue:
    """Batches of frames, first in, first out.

    When it is full the oldest frames give way, are counted, and an error frame "receive overflow"
    stands in their place.

    Parameters
    ----------
    limit : int
        Frames that it holds.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._slots: deque[Slot] = deque()
        self._held = 0
        self._gap_at: float | None = None
        self._is_closed = False
        self._changed = threading.Condition()
        self.dropped = 0
        """Frames that gave way to newer ones."""

    def put(self, batch: FrameBatch) -> None:
        """Add frames; never waits."""
        if len(batch):
            self._append(Slot(batch))

    def reserve(self, batch: FrameBatch) -> Slot:
        """Take a place for frames that are only about to happen.

        What is behind them waits until :meth:`settle`.
        """
        slot = Slot(batch, is_settled=False)
        self._append(slot)
        return slot

    def settle(self, slot: Slot, *, keep: bool) -> None:
        """Say whether the frames of a reserved place came to be.

        Parameters
        ----------
        slot : Slot
        keep : bool
            False gives the place up.
        """
        with self._changed:
            slot.is_settled = True
            if not keep and slot in self._slots:
                self._slots.remove(slot)
                self._held -= len(slot.batch)
            self._changed.notify_all()

    def take(self, wait: float = 0.0) -> FrameBatch:
        """Return everything up to the first place that is not settled.

        Parameters
        ----------
        wait : float
            How long to wait for something [s].

        Returns
        -------
        FrameBatch
            Empty when nothing came.
        """
        deadline = time.monotonic() + wait
        with self._changed:
            while not self._is_ready() and (self._slots or not self._is_closed):
                left = deadline - time.monotonic()
                if left <= 0:
                    break
                self._changed.wait(left)
            parts: list[FrameBatch] = []
            if self._gap_at is not None:
                parts.append(gap_marker(self._gap_at))
                self._gap_at = None
            parts.extend(self._pop_settled())
        return concatenate(parts)

    def close(self) -> None:
        """Let nobody wait any longer; what it holds can still be taken."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def __len__(self) -> int:
        return self._held

    def _append(self, slot: Slot) -> None:
        with self._changed:
            self._slots.append(slot)
            self._held += len(slot.batch)
            if self._held > self._limit:
                self._drop_oldest()
            if len(self._slots) > MOST_BATCHES:
                joined = concatenate(self._pop_settled())
                if len(joined):
                    self._held += len(joined)
                    self._slots.appendleft(Slot(joined))
            self._changed.notify_all()

    def _is_ready(self) -> bool:
        return bool(self._slots) and self._slots[0].is_settled

    def _pop_settled(self) -> list[FrameBatch]:
        parts: list[FrameBatch] = []
        while self._is_ready():
            parts.append(self._slots.popleft().batch)
            self._held -= len(parts[-1])
        return parts

    def _drop_oldest(self) -> None:
        while (excess := self._held - self._limit) > 0:
            oldest = self._slots[0]
            n = min(excess, len(oldest.batch))
            self._gap_at = float(oldest.batch.t[n - 1])
            oldest.batch = take(oldest.batch, slice(n, None))
            self._held -= n
            self.dropped += n
            if len(oldest.batch) == 0:
                self._slots.popleft()
