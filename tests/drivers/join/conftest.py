# SPDX-License-Identifier: Apache-2.0
"""Streams of frames whose samples are known, with faults put into them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest

from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.decode.table import Decoded, DecodeTable, decode
from comcal_drivers.devices.description import Device, load_device
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.join.joiner import Joiner
from comcal_drivers.join.sample import Counts, Samples, chain_samples

PERIOD = 0.01
"""Between two samples [s]."""
GAP = 0.0002
"""Between two frames of a sample [s]."""


@dataclass(frozen=True)
class Sent:
    """A frame and the sample that it belongs to; part -1 is the request."""

    id: int
    data: bytes
    t: float
    sample: int
    part: int


@dataclass(frozen=True)
class Speaker:
    """A device that sends samples whose values tell which sample they are of."""

    device: Device
    table: DecodeTable

    @property
    def parts(self) -> int:
        join = self.device.description.join
        return len(self.device.description.parts) if join.length is None else -(-join.length // 8)

    def values(self, sample: int) -> list[int]:
        """Raw values of a sample below 3000: any two samples differ in every one."""
        return [sample * 7 + 1000 * k for k in range(len(self.device.description.values))]

    def found(self, samples: Samples) -> list[int]:
        """Return which samples came out; fails if one is mixed of several."""
        channels = 1000 * np.arange(samples.values.shape[1])
        which, rest = np.divmod(samples.values - channels, 7)
        mixed = samples.values[(rest != 0).any(axis=1) | (which != which[:, :1]).any(axis=1)]
        assert not mixed.size, f"parts of different samples in one: {mixed}"
        return which[:, 0].astype(int).tolist()

    def send(self, samples: int, *, first: int = 0, requests: bool = True) -> list[Sent]:
        """Return the frames of *samples* samples."""
        description = self.device.description
        database = read_dbc(self.device.dbc)
        join = description.join
        frames = list[Sent]()
        for sample in range(first, first + samples):
            known = dict(zip(description.values, self.values(sample), strict=True))
            if join.signal is not None and join.modulus is not None:
                known[join.signal] = sample * max(1, join.step) % join.modulus
            t = sample * PERIOD
            if join.request is not None and requests:
                number = self.device.relocate(join.request.id)
                payload = bytes(join.request.data).ljust(join.request.length, b"\0")
                frames.append(Sent(number, payload, t, sample, -1))
            names = description.parts if join.message is None else [join.message]
            whole = b""
            for name in names:
                message = database.get_message_by_name(name)
                fields = {s.name: known.get(s.name, 0) for s in message.signals}
                whole += message.encode(fields, strict=False)
            if join.header:
                whole = bytes(join.header) + whole[len(join.header) :]
            if join.checksum is not None:
                whole = whole[:-2] + sum(whole[:-2]).to_bytes(2, "big")
            ids = [self.table.id_of(name) for name in description.parts]
            at = 0
            for part in range(self.parts):
                size = len(whole) // self.parts if join.message else self._size(part)
                number = ids[min(part, len(ids) - 1)]
                data = whole[at : at + size]
                frames.append(Sent(number, data, t + (part + 1) * GAP, sample, part))
                at += size
        return frames

    def _size(self, part: int) -> int:
        number = self.table.id_of(self.device.description.parts[part])
        return self.table.messages[number].length

    def joiner(self, **options: float) -> Joiner:
        return Joiner(self.device, self.table, **options)  # pyright: ignore[reportArgumentType]

    def join(
        self,
        frames: Sequence[Sent],
        cuts: Sequence[int] = (),
        *,
        stamps: bool = True,
        **options: float,
    ) -> tuple[Samples, Counts]:
        """Join frames, fed in pieces that end at *cuts*."""
        joiner = self.joiner(**options)
        pieces = list[Samples]()
        edges = sorted({0, len(frames), *(cut for cut in cuts if 0 < cut < len(frames))})
        for begin, end in pairwise(edges):
            batch = packed(frames[begin:end], stamps=stamps)
            pieces.append(joiner.feed(decode(self.table, batch), batch, begin))
        pieces.append(joiner.finish())
        counts = joiner.counts
        assert counts.balanced(joiner.parts)
        assert counts.frames == sum(f.sample >= 0 for f in frames)
        assert counts.pending == 0
        return chain_samples(pieces, len(self.device.description.values)), counts

    def decoded(self, batch: FrameBatch) -> Mapping[int, Decoded]:
        return decode(self.table, batch)

    @staticmethod
    def packed(frames: Sequence[Sent]) -> FrameBatch:
        return packed(frames)

    @staticmethod
    def moved(frames: list[Sent], at: int, by: int) -> list[Sent]:
        """Return the frames with the one at *at* coming *by* places later, stamped as it comes."""
        rest = frames[:at] + frames[at + 1 :]
        to = min(at + by, len(rest))
        late = replace(frames[at], t=rest[to - 1].t if to else frames[at].t)
        return [*rest[:to], late, *rest[to:]]

    @staticmethod
    def cut_short(frames: list[Sent], at: int) -> list[Sent]:
        """Return the frames with the last byte of one of them missing."""
        short = replace(frames[at], data=frames[at].data[:-1])
        return [*frames[:at], short, *frames[at + 1 :]]


def packed(frames: Sequence[Sent], *, stamps: bool = True) -> FrameBatch:
    """Return frames as a batch."""
    n = len(frames)
    data = np.zeros((n, 8), np.uint8)
    for row, frame in enumerate(frames):
        data[row, : len(frame.data)] = list(frame.data)
    return FrameBatch(
        np.array([f.t if stamps else np.nan for f in frames], np.float64),
        np.array([f.id for f in frames], np.uint32),
        np.array([len(f.data) for f in frames], np.uint8),
        data,
        np.zeros(n, np.uint8),
    )


@pytest.fixture(scope="session")
def speakers() -> dict[str, Speaker]:
    names = (
        "ati_netcanoem", "ati_netbox_short", "ati_netbox_long", "iit_strain", "jr3_uc3m",
        "sunrise_m8123", "robotous_rft", "optoforce",
    )  # fmt: skip
    found = dict[str, Speaker]()
    for name in names:
        device = load_device(name)
        found[name] = Speaker(device, bus_table(device))
    return found
