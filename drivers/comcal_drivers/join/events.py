# SPDX-License-Identifier: Apache-2.0
"""The frames of one device in the order in which they came, whichever message they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.robot.validate import did_you_mean
from comcal_drivers.decode.table import Decoded, DecodeTable
from comcal_drivers.devices.description import Description, Device
from comcal_drivers.frames.batch import ERROR, REMOTE, FrameBatch

Rows = npt.NDArray[np.intp]

REQUEST = -1
"""Code of a poll request; parts have theirs from 0."""
FRAME_BYTES = 8


@dataclass(frozen=True)
class Events:
    """Frames of one device, in order.

    Parameters
    ----------
    code : array of int64, shape (n,)
        Which part of a sample it is, or :data:`REQUEST`.
    row : array of int64, shape (n,)
        Running index since the start of the stream, increasing.
    t : array, shape (n,)
        [s], NaN without stamps.
    ok : array of bool, shape (n,)
        False where the frame is too short for its message.
    counter : array of int64, shape (n,)
        What the device counts; -1 where the frame does not say.
    status : array of int64, shape (n,)
        Trailing status byte, moved to the place of its part.
    raw : array, shape (n, w)
        Signals of the frame's part in the order of :class:`Columns`, or the payload's bytes.
    length : array of int64, shape (n,)
        Payload bytes.
    flags : array of uint8, shape (n,)
        Marks that the event hands on to its sample.
    """

    code: npt.NDArray[np.int64]
    row: npt.NDArray[np.int64]
    t: npt.NDArray[np.float64]
    ok: npt.NDArray[np.bool_]
    counter: npt.NDArray[np.int64]
    status: npt.NDArray[np.int64]
    raw: npt.NDArray[Any]
    length: npt.NDArray[np.int64]
    flags: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return int(self.code.size)

    def take(self, which: npt.NDArray[np.intp]) -> Events:
        """Return some of them."""
        return Events(*(getattr(self, f.name)[which] for f in fields(self)))


def chain_events(first: Events, second: Events) -> Events:
    """Return *first* followed by *second*."""
    if not len(first):
        return second
    return Events(
        *(np.concatenate([getattr(first, f.name), getattr(second, f.name)]) for f in fields(first))
    )


class Columns:
    """Which signal of which part is which column of the raw vector.

    Parameters
    ----------
    description : Description
    table : DecodeTable
        The device's messages, see :func:`~comcal_drivers.devices.tables.bus_table`.

    Raises
    ------
    ConfigError
        If a part or a signal that the description names is in no message.
    """

    def __init__(self, description: Description, table: DecodeTable) -> None:
        self.description = description
        ids = [_id_of(table, name, description.name) for name in description.parts]
        self.in_part = [[s.name for s in table.messages[i].signals] for i in ids]
        status = description.status.signal if description.status else None
        named = [*description.values, *([status] if status else [])]
        self.kept = [[n for n in dict.fromkeys(named) if n in part] for part in self.in_part]
        flat = [name for part in self.kept for name in part]
        for name in named:
            if name not in flat:
                raise ConfigError(
                    f"no part of device {description.name} has the signal {name!r}",
                    next_step="mend its YAML or its DBC",
                )
        self.values = [flat.index(name) for name in description.values]
        self.status = flat.index(status) if status else None
        self.width = max(1, *(len(part) for part in self.kept))


class Gatherer:
    """Picks the frames of one device out of decoded batches.

    Parameters
    ----------
    device : Device
    table : DecodeTable
    """

    def __init__(self, device: Device, table: DecodeTable) -> None:
        self.description = device.description
        self.join = self.description.join
        concatenates = self.join.message is not None
        self.columns = None if concatenates else Columns(self.description, table)
        self.ids = [_id_of(table, name, self.description.name) for name in self.description.parts]
        self.width = FRAME_BYTES if self.columns is None else self.columns.width
        request = self.join.request
        self.request_id = None if request is None else device.relocate(request.id)
        self.request_length = 0 if request is None else request.length
        self.request_data = np.array([] if request is None else request.data, np.uint8)
        select = self.description.select
        self.selected = None if select is None else float(device.ids[select.key])
        status = self.description.status
        self.trailer = None if status is None or status.trailer is None else status.trailer.byte
        self.dtype = np.dtype(np.uint8 if concatenates else np.float64)

    def nothing(self) -> Events:
        """Return no events."""
        none = np.empty(0, np.int64)
        raw, flags = np.empty((0, self.width), self.dtype), np.empty(0, np.uint8)
        return Events(none, none, np.empty(0), np.empty(0, np.bool_), none, none, raw, none, flags)

    def gather(self, decoded: Mapping[int, Decoded], batch: FrameBatch, first_row: int) -> Events:
        """Return the device's frames of a batch whose first frame has running index *first_row*."""
        requests = self._requests(batch)
        found = list[tuple[int, Decoded | None, Rows]]()
        if requests.size:
            found.append((REQUEST, None, requests))
        for code, number in enumerate(self.ids):
            part = decoded.get(number)
            if part is not None and len(part):
                found.append((code, part, self._ours(part, requests, batch)))
        row = np.concatenate([np.empty(0, np.intp), *(rows_of(d, which) for _, d, which in found)])
        order = np.argsort(row, kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        n, row = row.size, row[order]
        events = Events(
            np.full(n, REQUEST, np.int64),
            row.astype(np.int64) + first_row,
            batch.t[row],
            np.ones(n, np.bool_),
            np.full(n, -1, np.int64),
            np.zeros(n, np.int64),
            np.zeros((n, self.width), self.dtype),
            batch.lengths[row].astype(np.int64),
            np.zeros(n, np.uint8),
        )
        begin = 0
        for code, part, which in found:
            here = place[begin : begin + which.size]
            begin += which.size
            if part is not None:
                self._fill(events, here, code, part, which, batch)
        return events

    def _requests(self, batch: FrameBatch) -> Rows:
        """Return the rows of the host's polls."""
        if self.request_id is None:
            return np.empty(0, np.intp)
        plain = batch.kinds & (ERROR | REMOTE) == 0
        asked = (batch.ids == self.request_id) & (batch.lengths == self.request_length) & plain
        rows = np.flatnonzero(asked)
        size = self.request_data.size
        return rows[(batch.data[rows, :size] == self.request_data).all(axis=1)] if size else rows

    def _ours(self, part: Decoded, requests: Rows, batch: FrameBatch) -> Rows:
        """Return which frames of a message are parts of this device's samples."""
        keep = batch.kinds[part.rows] & (ERROR | REMOTE) == 0
        if requests.size:
            keep &= ~np.isin(part.rows, requests)
        if self.description.select is not None:
            keep &= part.values[self.description.select.signal] == self.selected
        return np.flatnonzero(keep)

    def _fill(
        self,
        events: Events,
        here: Rows,
        code: int,
        part: Decoded,
        which: Rows,
        batch: FrameBatch,
    ) -> None:
        """Write what the frames *which* of one message say to the places *here*."""
        rows = part.rows[which]
        events.code[here] = code
        events.ok[here] = ~part.bad[which]
        if self.trailer is not None and self.trailer < batch.data.shape[1]:
            longer = batch.lengths[rows] > self.trailer
            byte = batch.data[rows, self.trailer].astype(np.int64)
            events.status[here] = np.where(longer, byte, 0) << (8 * code)
        if self.columns is None:
            events.raw[here] = batch.data[rows, :FRAME_BYTES]
            return
        for column, name in enumerate(self.columns.kept[code]):
            events.raw[here, column] = part.values[name][which]
        if self.join.signal in self.columns.in_part[code]:
            count = part.values[self.join.signal][which]
            events.counter[here] = np.where(part.bad[which], -1.0, count).astype(np.int64)


def rows_of(part: Decoded | None, which: Rows) -> Rows:
    """Return the rows of frames *which* of a message; of no message they are rows already."""
    return which if part is None else part.rows[which]


def _id_of(table: DecodeTable, message: str, device: str) -> int:
    """Return the identifier of a message that the description names."""
    try:
        return table.id_of(message)
    except KeyError:
        raise ConfigError(
            f"the messages of device {device} lack {message!r}",
            next_step=did_you_mean(message, [m.name for m in table.messages.values()])
            or "mend its YAML or its DBC",
        ) from None
