# SPDX-License-Identifier: Apache-2.0
"""Reading a log piece by piece: seconds of it out of blocks that are cut anyhow."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from comcal.measure.pose_row import cut, join
from comcal.measure.source import Block

_ROUNDING = 1e-6
"""Stamps come in whole nanoseconds: a sample this little [s] before the end of a piece is the first
one of the next."""


class BlockReader:
    """A place in a log, from which one reads on.

    Parameters
    ----------
    blocks : callable
        Starts the log anew from a time [s] on, or somewhat earlier: ``Log.blocks``.
    """

    def __init__(self, blocks: Callable[[float], Iterator[Block]]) -> None:
        self._blocks = blocks
        self._iterator: Iterator[Block] | None = None
        self._ahead: Block | None = None
        self._passed = -np.inf
        self.t = -np.inf
        """Where the next piece begins [s]."""
        self.has_read = False
        """Whether there was any sample."""

    def go_to(self, t: float) -> None:
        """Let the next piece begin at *t*, before or after where this one is.

        Parameters
        ----------
        t : float
            [s]
        """
        if t < self._passed:
            self.close()
        self.t = t

    def read(self, duration: float, last: float = np.inf) -> Block | None:
        """Return the next piece of the log; the one after it begins *duration* later.

        Parameters
        ----------
        duration : float
            [s]
        last : float
            Time of the last sample that may be read [s].

        Returns
        -------
        Block or None
            None: there is nothing left.
        """
        parts: list[Block] = []
        end = self.t + duration
        while (block := self._next()) is not None:
            if not parts and block.t[-1] >= self.t - _ROUNDING:
                # The first piece of all begins at the first sample, one after a gap behind it.
                first = float(block.t[np.searchsorted(block.t, self.t - _ROUNDING)])
                end = first + duration if first >= end - _ROUNDING or np.isneginf(end) else end
            begin = int(np.searchsorted(block.t, self.t - _ROUNDING))
            until = min(
                int(np.searchsorted(block.t, end - _ROUNDING)),
                int(np.searchsorted(block.t, last, side="right")),
            )
            if until > begin:
                parts.append(cut(block, slice(begin, until)))
            rest = max(begin, until)
            if rest < block.t.size:
                self._ahead = cut(block, slice(rest, None))
                break
        if not parts:
            return None
        self.t = end
        self.has_read = True
        self._passed = float(parts[-1].t[-1])
        return join(parts)

    def close(self) -> None:
        """Let go of the log; the next piece would start it anew."""
        close = getattr(self._iterator, "close", None)
        if close is not None:
            close()
        self._iterator = self._ahead = None
        self._passed = -np.inf

    def _next(self) -> Block | None:
        """Return the next block that is not empty."""
        if self._ahead is not None:
            block, self._ahead = self._ahead, None
            return block
        if self._iterator is None:
            self._iterator = self._blocks(self.t)
        return next((block for block in self._iterator if block.t.size), None)
