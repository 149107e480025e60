# SPDX-License-Identifier: Apache-2.0
"""Samples of one device, and the account of every frame that did or did not become one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

STATUS, SATURATED, STALE, LOST, RESYNC = (np.uint8(1 << k) for k in range(5))
"""Bits of :attr:`Samples.flags`: the device complains, a channel is at its limit, the value is old,
samples were lost just before this one, pairing had to start anew before this one."""


@dataclass(frozen=True)
class Samples:
    """Samples of one device, in the order in which they were completed.

    Parameters
    ----------
    t : array, shape (n,)
        Stamp of the part that came first [s]; NaN without stamps.
    counter : array of int64, shape (n,)
        What the device counts, as sent (it wraps); -1 without a counter.
    last_row : array of int64, shape (n,)
        Running index, over all frames since the start of the stream, of the frame that completed
        the sample: it fixes the order between devices. It never decreases: a sample that had to
        wait for one before it counts as completed with that one.
    values : array, shape (n, k)
        Raw values in the order of ``values`` of the device's description.
    status : array of int64, shape (n,)
        Status word as sent; 0 where the device has none.
    flags : array of uint8, shape (n,)
        :data:`STATUS`, :data:`SATURATED`, :data:`STALE`, :data:`LOST`, :data:`RESYNC`.
        Joining sets the last two, calibration the first two.
    """

    t: npt.NDArray[np.float64]
    counter: npt.NDArray[np.int64]
    last_row: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]
    status: npt.NDArray[np.int64]
    flags: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return int(self.t.size)


def no_samples(channels: int) -> Samples:
    """Return zero samples of *channels* values."""
    return Samples(
        np.empty(0),
        np.empty(0, np.int64),
        np.empty(0, np.int64),
        np.empty((0, channels)),
        np.empty(0, np.int64),
        np.empty(0, np.uint8),
    )


def chain_samples(pieces: Iterable[Samples], channels: int) -> Samples:
    """Return *pieces* one after the other; all have *channels* values."""
    given = [no_samples(channels), *pieces]
    return Samples(
        np.concatenate([p.t for p in given]),
        np.concatenate([p.counter for p in given]),
        np.concatenate([p.last_row for p in given]),
        np.concatenate([p.values for p in given]),
        np.concatenate([p.status for p in given]),
        np.concatenate([p.flags for p in given]),
    )


@dataclass(frozen=True)
class Counts:
    """What became of the frames of one device.

    Every frame is accounted for once: ``frames = samples * parts + other + duplicated +
    orphaned + short + pending``.

    Parameters
    ----------
    frames : int
        Frames of the device that were looked at.
    samples : int
        Samples emitted.
    lost : int
        Samples known to be missing between those emitted.
    duplicated : int
        Frames dropped because the same part of the same sample was there already.
    orphaned : int
        Frames dropped because nothing proves to which sample they belong, or the rest is missing.
    short : int
        Frames dropped because they were too short, or their checksum was wrong.
    resyncs : int
        How often pairing or counting had to start anew, with an unknown number of samples lost.
    other : int
        Frames that are not part of a sample: poll requests, answers to commands.
    pending : int
        Frames held because the sample is not complete, or not yet proven.
    saturated : int
        Samples with a channel at its limit.
    status : mapping from bit to int
        Samples on which each bit of the status word was set, whether it is ignored or not.
    ignored_status : mapping from bit to int
        The part of ``status`` that the configuration ignores.
    """

    frames: int = 0
    samples: int = 0
    lost: int = 0
    duplicated: int = 0
    orphaned: int = 0
    short: int = 0
    resyncs: int = 0
    other: int = 0
    pending: int = 0
    saturated: int = 0
    status: Mapping[int, int] = field(default_factory=dict[int, int])
    ignored_status: Mapping[int, int] = field(default_factory=dict[int, int])

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.frames + other.frames,
            self.samples + other.samples,
            self.lost + other.lost,
            self.duplicated + other.duplicated,
            self.orphaned + other.orphaned,
            self.short + other.short,
            self.resyncs + other.resyncs,
            self.other + other.other,
            self.pending + other.pending,
            self.saturated + other.saturated,
            _sum(self.status, other.status),
            _sum(self.ignored_status, other.ignored_status),
        )

    def balanced(self, parts: int) -> bool:
        """Whether every frame of samples of *parts* frames is accounted for."""
        spent = self.other + self.duplicated + self.orphaned + self.short + self.pending
        return self.frames == self.samples * parts + spent

    def with_status(
        self, status: Mapping[int, int], ignored: Mapping[int, int], saturated: int
    ) -> Counts:
        """Return a copy with what calibration found."""
        return replace(self, status=status, ignored_status=ignored, saturated=saturated)


def _sum(a: Mapping[int, int], b: Mapping[int, int]) -> dict[int, int]:
    """Return the sums by key."""
    return {key: a.get(key, 0) + b.get(key, 0) for key in sorted(a.keys() | b.keys())}
