# SPDX-License-Identifier: Apache-2.0
"""From paired frames to samples: their values, and those that are spoilt left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal_drivers.decode.table import DecodeTable, decode
from comcal_drivers.devices.description import Checksum, Device
from comcal_drivers.devices.tables import whole_table
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.join.events import FRAME_BYTES, Columns, Events
from comcal_drivers.join.pairs import Pairs
from comcal_drivers.join.sample import LOST

Mask = npt.NDArray[np.bool_]


@dataclass
class Spoilt:
    """Samples that were paired and are none, and what became of their frames."""

    short: int = 0
    orphaned: int = 0
    other: int = 0
    lost: int = 0
    just_now: bool = False
    """Whether the last sample was one of them."""

    def leave_out(self, samples: Events, lost: Mask, other: Mask) -> Events:
        """Return the good samples; those after a lost one are marked."""
        good = ~(lost | other)
        self.lost += int(lost.sum())
        before = np.concatenate([[int(self.just_now)], self.just_now + np.cumsum(lost)])
        kept = np.flatnonzero(good)
        since = np.diff(before[kept], prepend=0)
        samples.flags[kept[since > 0]] |= LOST
        counted = int(before[kept[-1]]) if kept.size else 0
        self.just_now = bool(before[-1] > counted)
        return samples.take(kept)


class Reading:
    """Reads the samples of one device.

    Parameters
    ----------
    device : Device
    columns : Columns or None
        Of the parts' signals; None where their bytes are concatenated.
    """

    def __init__(self, device: Device, columns: Columns | None) -> None:
        self.description = device.description
        self.layout = whole_table(device) if columns is None else columns
        self.spoilt = Spoilt()

    def read(self, events: Events, pairs: Pairs) -> Events:
        """Return paired *events* as samples: one event each, with the raw vector as ``raw``."""
        index = pairs.index
        n, parts = index.shape
        first, last = (index.min(axis=1), index.max(axis=1)) if n else (index[:, 0], index[:, 0])
        status = np.bitwise_or.reduce(events.status[index], axis=1)
        flags = pairs.flags | np.bitwise_or.reduce(events.flags[index], axis=1)
        samples = Events(
            np.zeros(n, np.int64),
            events.row[last],
            events.t[first],
            np.logical_and.reduce(events.ok[index], axis=1),
            events.counter[index].max(axis=1) if n else np.empty(0, np.int64),
            status,
            np.empty((n, len(self.description.values))),
            np.full(n, parts, np.int64),
            flags.astype(np.uint8),
        )
        lost = ~samples.ok
        self.spoilt.short += int((~events.ok[index])[lost].sum())
        self.spoilt.orphaned += int(events.ok[index][lost].sum())
        if isinstance(self.layout, Columns):
            self._take_signals(self.layout, events, index, samples)
            other = np.zeros(n, np.bool_)
        else:
            damaged, other = self._take_bytes(self.layout, events, index, samples)
            other &= ~lost
            damaged &= ~(lost | other)
            self.spoilt.short += int(damaged.sum()) * parts
            self.spoilt.other += int(other.sum()) * parts
            lost |= damaged
        return self.spoilt.leave_out(samples, lost, other)

    def _take_signals(
        self, columns: Columns, events: Events, index: npt.NDArray[np.intp], samples: Events
    ) -> None:
        """Take the raw vector and the status from the signals of the parts."""
        flat = np.concatenate(
            [events.raw[index[:, p], : len(names)] for p, names in enumerate(columns.kept)], axis=1
        )
        samples.raw[:] = flat[:, columns.values]
        if columns.status is not None:
            word = flat[:, columns.status]
            samples.status[:] |= np.where(samples.ok, word, 0.0).astype(np.int64)

    def _take_bytes(
        self, table: DecodeTable, events: Events, index: npt.NDArray[np.intp], samples: Events
    ) -> tuple[Mask, Mask]:
        """Take everything from the joined bytes; return which are damaged, which no samples."""
        join = self.description.join
        ((number, message),) = table.messages.items()
        n = len(samples)
        data = np.zeros((n, 64), np.uint8)
        joined = events.raw[index].reshape(n, index.shape[1] * FRAME_BYTES)[:, : message.length]
        data[:, : joined.shape[1]] = joined
        batch = FrameBatch(
            samples.t,
            np.full(n, number, np.uint32),
            np.full(n, joined.shape[1], np.uint8),
            data,
            np.zeros(n, np.uint8),
        )
        values = decode(table, batch)[number].values
        for column, name in enumerate(self.description.values):
            samples.raw[:, column] = values[name]
        status = self.description.status
        if status is not None and status.signal is not None:
            samples.status[:] |= values[status.signal].astype(np.int64)
        if join.signal is not None:
            samples.counter[:] = values[join.signal].astype(np.int64)
        header = np.array(join.header, np.uint8)
        other = (data[:, : header.size] != header).any(axis=1)
        return ~_sums_agree(joined, join.checksum), other


def _sums_agree(payload: npt.NDArray[np.uint8], checksum: Checksum | None) -> Mask:
    """Tell which payloads end with the sum of their bytes."""
    if checksum is None:
        return np.ones(len(payload), np.bool_)
    size, modulus = (2, 1 << 16) if checksum.kind == "sum16_be" else (1, 1 << 8)
    sums = payload[:, :-size].sum(axis=1, dtype=np.int64) % modulus
    weights = 256 ** np.arange(size - 1, -1, -1)
    return sums == payload[:, -size:].astype(np.int64) @ weights
