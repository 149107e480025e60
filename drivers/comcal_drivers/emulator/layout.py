# SPDX-License-Identifier: Apache-2.0
"""The frames of one device: raw values to frames, and changes to frames that are made already."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from cantools.database.can import Message

from comcal.robot.tree import Array
from comcal_drivers.decode.dbc import read_dbc
from comcal_drivers.devices.description import Checksum, Description, Device
from comcal_drivers.emulator.encode import Bytes, encode, raw_limits, raw_of, with_raw
from comcal_drivers.emulator.frame import EXTENDED, Frame

FRAME_BYTES = 8
"""Payload of a frame of classic CAN."""
FREE_STEP = 7
"""Of counters that do not count what is sent: they run on between the samples."""

_Change = Callable[[int], int]


class LimitBits(Protocol):
    """Which bits of the status word say that a channel is at its limit."""

    def __call__(self, channel: int, *, high: bool) -> tuple[int, ...]:
        """Return them; none where the device does not say."""
        ...


@dataclass(frozen=True)
class RawSamples:
    """What a device measured, in the numbers that it sends.

    Parameters
    ----------
    values : array, shape (n, k)
        Raw values in the order of ``values`` of the description.
    count : array of int64, shape (n,)
        Running number of each sample, without wrap.
    t : array, shape (n,)
        [s]
    extra : mapping from signal name to array, shape (n,)
        Other signals of the parts: a temperature, a status word.
    """

    values: Array
    count: npt.NDArray[np.int64]
    t: Array
    extra: Mapping[str, Array]


class DeviceLayout:
    """How a device puts samples into frames.

    Parameters
    ----------
    name : str
        In robot.yaml.
    device : Device
    limit_bits : callable
        Takes a channel and whether it is the upper limit, returns the bits of the status word with
        which the device reports it.
    counter_step : int or None
        By which its counter grows from sample to sample; None: as described.
    """

    def __init__(
        self, name: str, device: Device, limit_bits: LimitBits, counter_step: int | None = None
    ) -> None:
        self.name = name
        self._limit_bits = limit_bits
        described = device.description.join.step if counter_step is None else counter_step
        self.counter_step = described or FREE_STEP
        self.device = device
        self.description: Description = device.description
        self._database = read_dbc(device.dbc)

    @cached_property
    def messages(self) -> tuple[Message, ...]:
        """Messages that carry the sample: its parts, or the one that they are pieces of."""
        join = self.description.join
        names = self.description.parts if join.message is None else (join.message,)
        return tuple(self._database.get_message_by_name(name) for name in names)

    @cached_property
    def part_ids(self) -> tuple[int, ...]:
        """Identifiers on the bus of the parts, in order."""
        return tuple(self.message_id(name) for name in self.description.parts)

    def message_id(self, name: str) -> int:
        """Return the identifier on the bus of a message, with its flag."""
        message = self._database.get_message_by_name(name)
        flag = EXTENDED if message.is_extended_frame else 0
        return self.device.relocate(message.frame_id) | flag

    @cached_property
    def saturation(self) -> tuple[Array, Array]:
        """Raw values at which each channel saturates, low and high, shape (k,) each.

        Where the description names none, the limits of the bits.
        """
        force_torque = self.description.calibrate.force_torque
        levels = None if force_torque is None else force_torque.saturation
        low, high = list[float](), list[float]()
        for name in self.description.values:
            signal = next(s for m in self.messages for s in m.signals if s.name == name)
            least, most = raw_limits(signal) if not signal.is_float else (-np.inf, np.inf)
            scale, offset = float(signal.scale), float(signal.offset)
            low.append(max(least * scale + offset, -np.inf if levels is None else levels.low))
            high.append(min(most * scale + offset, np.inf if levels is None else levels.high))
        return np.array(low), np.array(high)

    def frames(self, samples: RawSamples) -> list[list[Frame]]:
        """Return the frames of every sample, in order.

        Values beyond a saturation limit are held there, and reported where the device reports it.
        """
        low, high = self.saturation
        n = samples.t.size
        columns = self._columns(replace(samples, values=np.clip(samples.values, low, high)))
        payloads = [_payloads(encode(message, columns, n)) for message in self.messages]
        made = [
            self._cut([payload[row] for payload in payloads], int(count), float(t))
            for row, (count, t) in enumerate(zip(samples.count, samples.t, strict=True))
        ]
        over, under = samples.values > high, samples.values < low
        for row, channel in np.argwhere(over | under):
            made[row] = self._report_limit(made[row], int(channel), bool(over[row, channel]))
        return made

    def message_frame(self, name: str, columns: Mapping[str, Array], t: float) -> Frame:
        """Return a frame of another message than the parts of a sample.

        Parameters
        ----------
        name : str
            In the DBC.
        columns : mapping from signal name to array, shape (1,)
        t : float
            [s]
        """
        message = self._database.get_message_by_name(name)
        return Frame(
            self.message_id(name), encode(message, columns, 1)[0].tobytes(), t, device=self.name
        )

    def _columns(self, samples: RawSamples) -> dict[str, Array]:
        columns = dict(samples.extra)
        columns.update(zip(self.description.values, samples.values.T, strict=True))
        join = self.description.join
        if join.signal is not None and join.modulus is not None:
            own = np.mod(samples.count * self.counter_step, join.modulus)
            columns[join.signal] = own.astype(np.float64)
        return columns

    def _cut(self, pieces: Sequence[bytes], count: int, t: float) -> list[Frame]:
        """Return the frames of one sample from the payloads of its messages."""
        join = self.description.join
        ids = self.part_ids
        if join.message is not None:
            whole = self._finished(pieces[0])
            pieces = [whole[i : i + FRAME_BYTES] for i in range(0, len(whole), FRAME_BYTES)]
            ids = tuple(ids[min(i, len(ids) - 1)] for i in range(len(pieces)))
        return [
            Frame(id_, piece, t, 0, self.name, part, count)
            for part, (id_, piece) in enumerate(zip(ids, pieces, strict=True))
        ]

    def _finished(self, whole: bytes) -> bytes:
        """Return a longer message with its header and its checksum."""
        join = self.description.join
        whole = bytes(join.header) + whole[len(join.header) :]
        return whole if join.checksum is None else with_checksum(whole, join.checksum)

    # Changes to a sample that is made already

    @property
    def has_status(self) -> bool:
        """Whether the device sends a status word."""
        return self.description.status is not None

    @property
    def modulus(self) -> int | None:
        """What the counter in the frames is counted modulo; None without one."""
        return self.description.join.modulus

    @property
    def channels(self) -> int:
        """Number of raw values of a sample."""
        return len(self.description.values)

    def with_status(self, frames: Sequence[Frame], bit: int) -> list[Frame]:
        """Return a sample whose status word has *bit* set."""
        status = self.description.status
        if status is None:
            return list(frames)
        if status.trailer is None:
            signal = status.signal or ""
            return self._edited(frames, signal, lambda raw: raw | (1 << bit))
        part, within = divmod(bit, 8)
        frame = frames[part]
        data = bytearray(frame.data.ljust(status.trailer.byte + 1, b"\0"))
        data[status.trailer.byte] |= 1 << within
        return [frame._replace(data=bytes(data)) if i == part else f for i, f in enumerate(frames)]

    def with_count(self, frames: Sequence[Frame], by: int) -> list[Frame]:
        """Return a sample whose counter is *by* further."""
        join = self.description.join
        if join.signal is None or join.modulus is None:
            return list(frames)
        modulus = join.modulus
        return self._edited(
            frames, join.signal, lambda raw: (raw + by * self.counter_step) % modulus
        )

    def with_limit(self, frames: Sequence[Frame], channel: int, *, low: bool) -> list[Frame]:
        """Return a sample with one channel at its limit, and reported where the device does."""
        name = self.description.values[channel]
        level = float(self.saturation[0 if low else 1][channel])
        message = next(m for m in self.messages if any(s.name == name for s in m.signals))
        signal = message.get_signal_by_name(name)
        if signal.is_float:  # it has no limits; a converter at its end would say so
            return self._report_limit(frames, channel, not low)
        raw = round((level - float(signal.offset)) / float(signal.scale))
        return self._report_limit(self._edited(frames, name, lambda _: raw), channel, not low)

    def _report_limit(self, frames: Sequence[Frame], channel: int, high: bool) -> list[Frame]:
        """Set the bits of the status word that mean this limit, where there are any."""
        reported = list(frames)
        for bit in self._limit_bits(channel, high=high):
            reported = self.with_status(reported, bit)
        return reported

    def _edited(self, frames: Sequence[Frame], signal: str, change: _Change) -> list[Frame]:
        """Return a sample with the raw integer of a signal changed wherever it stands."""
        if self.description.join.message is not None:
            whole = b"".join(frame.data for frame in frames)
            changed = self._finished(_changed(self.messages[0], whole, signal, change))
            pieces = list[Frame]()
            for frame in frames:
                piece, changed = changed[: len(frame.data)], changed[len(frame.data) :]
                pieces.append(frame._replace(data=piece))
            return pieces
        return [
            frame._replace(data=_changed(self.messages[frame.part], frame.data, signal, change))
            for frame in frames
        ]


def _payloads(encoded: Bytes) -> list[bytes]:
    """Return the rows as bytes."""
    size, text = encoded.shape[1], encoded.tobytes()
    return [text[i : i + size] for i in range(0, len(text), size)] if size else []


def with_checksum(whole: bytes, checksum: Checksum) -> bytes:
    """Return a message whose last bytes are the sum of those before them."""
    if checksum.kind == "sum16_be":
        body = whole[:-2]
        return body + (sum(body) & 0xFFFF).to_bytes(2, "big")
    body = whole[:-1]
    return body + bytes([sum(body) & 0xFF])


def _changed(message: Message, data: bytes, signal: str, change: _Change) -> bytes:
    """Return a payload with one raw integer changed; as it was where the signal is not in it."""
    if all(s.name != signal for s in message.signals) or len(data) < message.length:
        return data
    layout = message.get_signal_by_name(signal)
    return with_raw(layout, data, change(raw_of(layout, data)))
