# SPDX-License-Identifier: Apache-2.0
"""The messages of one sender on their way into rows: stamps in order, newest value before a row.

Messages are written when they arrive, not when they were measured; a row waits for them for
``LATENESS``. What a row gets does not depend on how the stream of messages is cut.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from comcal.errors import DataError
from comcal.robot.tree import Array
from comcal_drivers.bags.messages import NANOSECONDS

Stamps = npt.NDArray[np.int64]

LATENESS = NANOSECONDS // 2
"""A message that is written later than this [ns] after a row does not count for it any more."""
RESET = NANOSECONDS
"""Stamps that go back by more than this [ns] are not late: the clock was set."""
_KEPT = 2 * NANOSECONDS
"""Of messages that were written this long ago [ns] only the newest is kept."""


@dataclass
class Counts:
    """What was not used, by channel.

    Parameters
    ----------
    duplicated : dict from str to int
        Messages with the stamp of the one before.
    late : dict from str to int
        Messages with an older stamp than one before.
    malformed : dict from str to int
        Messages whose arrays have other lengths than their names.
    stale : dict from str to int
        Rows for which the newest value was too old, or there was none yet.
    """

    duplicated: dict[str, int] = field(default_factory=dict[str, int])
    late: dict[str, int] = field(default_factory=dict[str, int])
    malformed: dict[str, int] = field(default_factory=dict[str, int])
    stale: dict[str, int] = field(default_factory=dict[str, int])

    def lost(self) -> dict[str, int]:
        """Return all of them by ``channel kind``, without zeros."""
        kinds = {
            "duplicated": self.duplicated,
            "late": self.late,
            "malformed": self.malformed,
            "stale": self.stale,
        }
        return {
            f"{channel} {kind}": count
            for kind, counts in kinds.items()
            for channel, count in counts.items()
            if count
        }


def count(counts: dict[str, int], channel: str, more: int = 1) -> None:
    """Add to one of the ``Counts``."""
    counts[channel] = counts.get(channel, 0) + more


class Stream:
    """What one sender says, as far as rows may still need it.

    Parameters
    ----------
    channel : str
        For counts and messages.
    width : int
        How many numbers a message has.
    counts : Counts
    """

    def __init__(self, channel: str, width: int, counts: Counts) -> None:
        self._width = width
        self._channel = channel
        self._counts = counts
        self._newest: int | None = None
        self._new: list[tuple[int, int, bytes]] = []
        self._stamps = np.empty(0, dtype=np.int64)
        self._logged = np.empty(0, dtype=np.int64)
        self._numbers = np.empty((0, width))

    def add(self, stamp: int, logged: int, numbers: bytes) -> None:
        """Take a message, unless there is a newer one already.

        Parameters
        ----------
        stamp, logged : int
            When it was measured and written [ns]; ``logged`` never decreases.
        numbers : bytes
            ``width`` little-endian float64.

        Raises
        ------
        DataError
            If the clock of its stamps was set back.
        """
        if self._newest is not None and stamp <= self._newest:
            back = self._newest - stamp
            if back > RESET:
                raise DataError(
                    "stamps go back: the clock was set, or two senders disagree",
                    where=self._channel,
                    measured=f"by {back / NANOSECONDS:.3f} s",
                    limit=f"{RESET / NANOSECONDS:g} s",
                    next_step="set stamps: log in sources.bag, or cut the bag there",
                )
            count(self._counts.late if back else self._counts.duplicated, self._channel)
            return
        self._newest = stamp
        self._new.append((stamp, logged, numbers))

    def at(self, stamps: Stamps, logged: Stamps) -> tuple[Stamps, Array]:
        """Return the newest message for every row: its stamp, and its numbers.

        Parameters
        ----------
        stamps, logged : array of int, shape (n,)
            When the rows were measured and written [ns], both increasing.

        Returns
        -------
        stamps : array of int, shape (n,)
            Very old where there is no message.
        numbers : array, shape (n, width)
        """
        self._merge()
        index = np.minimum(
            np.searchsorted(self._stamps, stamps, side="right"),
            np.searchsorted(self._logged, logged + LATENESS, side="right"),
        )
        own = np.concatenate([[np.iinfo(np.int64).min // 2], self._stamps])
        numbers = np.vstack([np.full(self._width, np.nan), self._numbers])
        return own[index], numbers[index]

    def take(self, written_before: int) -> tuple[Stamps, Stamps]:
        """Remove the messages that were written before a time [ns]; return stamps and times."""
        self._merge()
        n = int(np.searchsorted(self._logged, written_before))
        taken = self._stamps[:n], self._logged[:n]
        self._drop(n)
        return taken

    def forget(self, now: int) -> None:
        """Drop what was written long before *now* [ns], but for the newest of it."""
        self._merge()
        old = int(np.searchsorted(self._logged, now - _KEPT))
        self._drop(max(old - 1, 0))

    def _merge(self) -> None:
        if not self._new:
            return
        stamps, logged, numbers = zip(*self._new, strict=True)
        self._new = []
        self._stamps = np.concatenate([self._stamps, np.array(stamps, dtype=np.int64)])
        self._logged = np.concatenate([self._logged, np.array(logged, dtype=np.int64)])
        rows = np.frombuffer(b"".join(numbers), dtype="<f8")
        rows = rows.reshape(len(logged), self._width)
        self._numbers = np.concatenate([self._numbers, rows])

    def _drop(self, n: int) -> None:
        self._stamps, self._logged = self._stamps[n:], self._logged[n:]
        self._numbers = self._numbers[n:]
