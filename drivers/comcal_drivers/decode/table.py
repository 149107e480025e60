# SPDX-License-Identifier: Apache-2.0
"""Decode batches of frames, all frames of one identifier at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal_drivers.decode.signals import Doubles, Payloads, SignalLayout, signal_layout
from comcal_drivers.frames.batch import ERROR, EXTENDED, REMOTE, FrameBatch
from comcal_drivers.frames.batches import CLASSIC, LONG

if TYPE_CHECKING:
    from cantools.database.can import Database, Message

LARGEST_STANDARD, LARGEST_EXTENDED = 0x7FF, 0x1FFFFFFF


@dataclass(frozen=True)
class MessageLayout:
    """A message as the table decodes it.

    Parameters
    ----------
    name : str
    length : int
        Payload bytes; frames may be longer, not shorter.
    signals : tuple of SignalLayout
        Multiplexers before what they select.
    """

    name: str
    length: int
    signals: tuple[SignalLayout, ...]


@dataclass(frozen=True)
class DecodeTable:
    """The messages that are decoded.

    Parameters
    ----------
    messages : mapping from int to MessageLayout
        By identifier as in :class:`~comcal_drivers.frames.batch.FrameBatch`: with
        :data:`~comcal_drivers.frames.batch.EXTENDED` set for those of 29 bits.
    """

    messages: Mapping[int, MessageLayout]

    def id_of(self, name: str) -> int:
        """Return the identifier of the message called *name*.

        Raises
        ------
        KeyError
            If there is none.
        """
        for number, message in self.messages.items():
            if message.name == name:
                return number
        raise KeyError(name)


@dataclass(frozen=True)
class Decoded:
    """All frames of one message within a batch.

    Parameters
    ----------
    rows : array of int, shape (m,)
        Their places in the batch, increasing.
    values : mapping from signal name to array, shape (m,)
        In the unit of the file; NaN in frames that are *bad* and where another value of the
        multiplexer was sent.
    bad : array of bool, shape (m,)
        The frame is shorter than the message: its DLC is wrong.
    """

    rows: npt.NDArray[np.intp]
    values: Mapping[str, Doubles]
    bad: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return int(self.rows.size)


def table_from_dbc(database: Database, ids: Callable[[int], int] | None = None) -> DecodeTable:
    """Compile all messages of a file.

    Parameters
    ----------
    database : cantools Database
        From :func:`~comcal_drivers.decode.dbc.read_dbc`.
    ids : callable, optional
        Takes an identifier of the file (11 or 29 bits, without :data:`EXTENDED`) to the one on
        the bus: base address, node number.

    Returns
    -------
    DecodeTable

    Raises
    ------
    ConfigError
        See :func:`table_from_messages`.
    """
    return table_from_messages(database.messages, ids)


def table_from_messages(
    messages: Iterable[Message], ids: Callable[[int], int] | None = None
) -> DecodeTable:
    """Compile messages of cantools.

    Parameters
    ----------
    messages : iterable of cantools Message
    ids : callable, optional
        As in :func:`table_from_dbc`.

    Returns
    -------
    DecodeTable

    Raises
    ------
    ConfigError
        If two messages have one identifier, if one is outside of the 11 or 29 bits, or if a
        signal cannot be decoded.
    """
    compiled: dict[int, MessageLayout] = {}
    for message in messages:
        number = message.frame_id if ids is None else ids(message.frame_id)
        largest = LARGEST_EXTENDED if message.is_extended_frame else LARGEST_STANDARD
        if not 0 <= number <= largest:
            raise ConfigError(
                "the identifier does not exist on a bus",
                where=f"message {message.name}",
                measured=f"0x{number:X}",
                limit=f"0x{largest:X}",
                next_step="mend the base address or the node number in robot.yaml",
            )
        if message.is_extended_frame:
            number |= int(EXTENDED)
        if number in compiled:
            raise ConfigError(
                f"two messages have the identifier 0x{number & LARGEST_EXTENDED:X}",
                where=f"messages {compiled[number].name} and {message.name}",
                next_step="give each device its own base address or node number",
            )
        compiled[number] = _message_layout(message)
    return DecodeTable(compiled)


def decode(table: DecodeTable, batch: FrameBatch) -> dict[int, Decoded]:
    """Return the signals of all frames that the table knows.

    Parameters
    ----------
    table : DecodeTable
    batch : FrameBatch
        Error frames and remote requests carry no signals and are passed over.

    Returns
    -------
    dict from int to Decoded
        One entry for every message of the table, empty where none came. Values equal those of
        cantools' ``decode(payload, decode_choices=False)`` to the last bit. Where cantools refuses
        a whole frame because its multiplexer has a value that the file does not know, here the
        multiplexed signals are NaN and the others are given.
    """
    plain = batch.kinds & (ERROR | REMOTE) == 0
    ids = batch.ids if plain.all() else np.where(plain, batch.ids, ~np.uint32(0))
    return {
        number: _decode_rows(layout, batch, np.flatnonzero(ids == np.uint32(number)))
        for number, layout in table.messages.items()
    }


def _decode_rows(layout: MessageLayout, batch: FrameBatch, rows: npt.NDArray[np.intp]) -> Decoded:
    bad = batch.lengths[rows] < layout.length
    if bad.all():  # none at all, too; and the batch may be narrower than the message
        return Decoded(rows, {s.name: np.full(rows.size, np.nan) for s in layout.signals}, bad)
    payloads = _rows_of(batch.data, rows)
    any_bad = bool(bad.any())
    values: dict[str, Doubles] = {}
    # A float may be anything: infinite, not a number, too large once scaled. So it was sent.
    with np.errstate(all="ignore"):
        for signal in layout.signals:
            value = signal.values(payloads)
            if any_bad:
                value[bad] = np.nan
            if signal.multiplexer is not None:
                # cantools cuts what comes after the point of a scaled multiplexer.
                sent = np.isin(np.trunc(values[signal.multiplexer]), list(signal.selected_by))
                value[~sent] = np.nan
            values[signal.name] = value
    return Decoded(rows, values, bad)


def _rows_of(data: Payloads, rows: npt.NDArray[np.intp]) -> Payloads:
    """Return some payloads, contiguous; eight bytes move as one word."""
    if data.shape[1] == CLASSIC and data.flags.c_contiguous:
        return data.view(np.uint64)[rows].view(np.uint8)
    return np.ascontiguousarray(data[rows])


def _message_layout(message: Message) -> MessageLayout:
    if message.is_container or message.length > LONG:
        raise ConfigError(
            "containers and messages of more than 64 bytes are not decoded",
            where=f"message {message.name}",
            next_step="remove it from the file",
        )
    signals = [signal_layout(message, signal) for signal in message.signals]
    return MessageLayout(message.name, message.length, tuple(_multiplexers_first(message, signals)))


def _multiplexers_first(message: Message, signals: list[SignalLayout]) -> list[SignalLayout]:
    ordered = [signal for signal in signals if signal.multiplexer is None]
    waiting = [signal for signal in signals if signal.multiplexer is not None]
    while waiting:
        known = {signal.name for signal in ordered}
        ready = [signal for signal in waiting if signal.multiplexer in known]
        if not ready:
            raise ConfigError(
                f"there is no multiplexer {waiting[0].multiplexer} for {waiting[0].name}",
                where=f"message {message.name}",
                next_step="mend the multiplexing in the file",
            )
        ordered += ready
        waiting = [signal for signal in waiting if signal not in ready]
    return ordered
