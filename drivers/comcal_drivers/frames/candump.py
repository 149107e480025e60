# SPDX-License-Identifier: Apache-2.0
"""Read the texts of candump, thousands of lines at a time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from comcal.errors import DataError
from comcal_drivers.frames.batch import ERROR, EXTENDED, FrameBatch
from comcal_drivers.frames.batches import LONG, empty_batch, take, widened
from comcal_drivers.frames.digits import identifiers, payload_bytes, stamps
from comcal_drivers.frames.shapes import CONSOLE, LOG, SKIPPED, Shape, Text, shape_of

BLOCK = 1 << 19
"""Bytes read at a time: what numpy does with them stays in the processor's cache."""

LONGEST_LINE = 1 << 12
"""Bytes: a file with longer lines is another kind of file."""

WORD = 8
"""Letters that are compared at once."""

STANDARD_DIGITS = 3
LARGEST_STANDARD, LARGEST_EXTENDED = np.uint32(0x7FF), np.uint32(0x1FFFFFFF)

ERROR_FLAG = np.uint32(1 << 29)
"""SocketCAN's mark of an error frame in an identifier of eight digits; below it, the class."""

LINE_FEED = 10


Shapes = dict[int, list[Shape]]
"""Shapes of the lines of every length."""


@dataclass(frozen=True)
class Piece:
    """Consecutive lines of a text.

    Parameters
    ----------
    batch : FrameBatch
    channels : tuple of str
        Names of the interfaces.
    channel : array of int, shape (len(batch),)
        Which of them each frame came from.
    torn : int
        Lines without an end that were skipped: 1 for the last piece of a log whose writer died.
    """

    batch: FrameBatch
    channels: tuple[str, ...]
    channel: npt.NDArray[np.intp]
    torn: int = 0


def dialect_of(path: Path) -> re.Pattern[bytes] | None:
    """Return in which of its two texts candump wrote a file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    re.Pattern or None
        :data:`LOG` or :data:`CONSOLE`, after the first line that holds a frame; None if none of
        the first lines does. An empty file is a log without frames.
    """
    with path.open("rb") as file:
        head = file.read(LONGEST_LINE)
    if not head.strip(b"\0\r\n \t"):
        return LOG
    for line in head.split(b"\n"):
        for dialect in (LOG, CONSOLE):
            if shape_of(line, dialect) is not None:
                return dialect
    # A log that was cut within its first line.
    return LOG if b"\n" not in head and head.startswith(b"(") else None


def read_text(path: Path, dialect: re.Pattern[bytes]) -> Iterator[Piece]:
    """Yield the frames of a text.

    Parameters
    ----------
    path : Path
    dialect : re.Pattern
        :data:`LOG` or :data:`CONSOLE`.

    Yields
    ------
    Piece

    Raises
    ------
    DataError
        At a line that does not hold a frame. A last line without a line feed is not one: whoever
        wrote it did not come to its end, and half a payload looks like a short one.
    """
    lines = 0
    rest = b""
    shapes: Shapes = {}
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            end = block.rfind(b"\n") + 1
            if end:
                text = rest + block[:end]
                rest = block[end:]
                piece, count, shapes = _read_lines(text, dialect, shapes, path, lines)
                yield piece
                lines += count
            else:
                rest += block
            if len(rest.strip(b"\0")) > LONGEST_LINE:
                raise _not_a_frame(rest, path, lines + 1)
    if rest.strip(b"\0\r\n\t "):
        yield Piece(empty_batch(0), (), np.empty(0, np.intp), torn=1)


def _read_lines(
    text: bytes, dialect: re.Pattern[bytes], known: Shapes, path: Path, before: int
) -> tuple[Piece, int, Shapes]:
    """Read whole lines, those of one length and shape at a time; return their number, too."""
    letters = np.frombuffer(text + bytes(2 * WORD), np.uint8)
    ends = np.flatnonzero(letters == LINE_FEED)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts
    columns = _Columns(ends.size)
    used: Shapes = {}
    for length in np.flatnonzero(np.bincount(lengths)).tolist():
        rows = np.flatnonzero(lengths == length)
        words = _words_at(letters, starts[rows], length)
        before_these = iter(known.get(length, ()))
        while rows.size:
            shape = next(before_these, None)
            if shape is None:
                first = rows[0]
                line = text[starts[first] : ends[first]]
                shape = shape_of(line, dialect)
                if shape is None:
                    if not SKIPPED.fullmatch(line):
                        raise _not_a_frame(line, path, before + int(first) + 1)
                    rows, words = rows[1:], words[1:]
                    continue
            fits = shape.fits(words)
            if fits.all():
                alike, lines = rows, words
                rows = rows[:0]
            elif fits.any():
                alike, lines = rows[fits], words[fits]
                rows, words = rows[~fits], words[~fits]
            else:
                continue
            used.setdefault(length, []).append(shape)
            if not columns.fill(alike, lines.view(np.uint8), shape):
                for row in alike.tolist():
                    line = text[starts[row] : ends[row]]
                    if shape_of(line, dialect) is None:
                        raise _not_a_frame(line, path, before + row + 1)
    return columns.piece(), ends.size, used


class _Columns:
    """The frames of a block while its lines are being read."""

    def __init__(self, lines: int) -> None:
        self._batch = empty_batch(lines)
        self._data = self._batch.data
        self._channel = np.full(lines, -1, np.intp)
        self._channels: list[str] = []

    def fill(self, rows: npt.NDArray[np.intp], lines: Text, shape: Shape) -> bool:
        """Read lines of one shape; return whether all that should be digits are."""
        good = True
        if shape.stamp is not None:
            self._batch.t[rows], good = stamps(lines[:, shape.stamp], shape.point)
        ids, are_digits = identifiers(lines[:, shape.number])
        good &= are_digits
        if shape.number.stop - shape.number.start == STANDARD_DIGITS:
            good &= bool(ids.max() <= LARGEST_STANDARD)
            if shape.kind:
                self._batch.kinds[rows] = shape.kind
        else:
            good &= bool(ids.max() <= ERROR_FLAG | LARGEST_EXTENDED)
            is_error = ids & ERROR_FLAG != 0
            self._batch.kinds[rows] = np.uint8(shape.kind) | is_error * ERROR
            ids = ids & LARGEST_EXTENDED | ~is_error * EXTENDED
        self._batch.ids[rows] = ids
        self._batch.lengths[rows] = shape.length
        if shape.data.stop > shape.data.start:
            if shape.length > self._data.shape[1]:
                self._data = widened(self._data, LONG)
            payload, are_digits = payload_bytes(_pairs(lines, shape))
            good &= are_digits
            self._data[rows, : shape.length] = payload
        if shape.channel not in self._channels:
            self._channels.append(shape.channel)
        self._channel[rows] = self._channels.index(shape.channel)
        return good

    def piece(self) -> Piece:
        """Return what was filled in, without the lines that held no frame."""
        batch = replace(self._batch, data=self._data)
        is_frame = self._channel >= 0
        if is_frame.all():
            return Piece(batch, tuple(self._channels), self._channel)
        return Piece(take(batch, is_frame), tuple(self._channels), self._channel[is_frame])


def _words_at(letters: Text, starts: npt.NDArray[np.intp], length: int) -> npt.NDArray[np.uint64]:
    """Return lines of equal length, shape (m, w), eight letters to a word."""
    count = max(1, -(-length // WORD))  # the last word holds some letters of what follows, too
    size = WORD * count
    windows = np.ndarray((letters.size - size + 1,), f"V{size}", letters, strides=(1,))
    return windows[starts].view(np.uint64).reshape(-1, count)


def _pairs(lines: Text, shape: Shape) -> Text:
    """Return the payload's digits without blanks between them."""
    if shape.step == 2:
        return np.ascontiguousarray(lines[:, shape.data])
    pairs = np.empty((lines.shape[0], shape.length, 2), np.uint8)
    for k in (0, 1):
        pairs[:, :, k] = lines[:, shape.data.start + k : shape.data.stop : shape.step]
    return pairs.reshape(lines.shape[0], -1)


def _not_a_frame(line: bytes, path: Path, number: int) -> DataError:
    shown = line[:60].decode("ascii", "backslashreplace")
    return DataError(
        f"the line does not hold a CAN frame: {shown!r}",
        where=f"{path}:{number}",
        next_step="remove the line, or log with candump -L (read are that, and what candump shows"
        " without its options -c, -S, -8, -t A)",
    )
