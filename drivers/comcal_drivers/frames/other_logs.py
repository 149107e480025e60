# SPDX-License-Identifier: Apache-2.0
"""Logs that python-can reads: ASC, BLF, TRC, CSV, MF4; what it cannot read is put into words."""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Iterator
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from comcal.errors import DataError, MissingExtraError

if TYPE_CHECKING:
    from can import Message
    from can.io.generic import MessageReader

TEXTS = (".asc", ".trc", ".csv")
ENDINGS = (*TEXTS, ".blf", ".mf4")

MDF = b"MDF     "

LAST_OF_ASC = "end triggerblock"
"""Last line of a whole ASC file; some programs leave its line feed away."""


class OtherLog:
    """A log as an iterable of the messages that python-can finds in it.

    Parameters
    ----------
    path : Path
        With one of :data:`ENDINGS`.

    Attributes
    ----------
    torn : int
        1 once the end is reached of a log whose writer died while it wrote, else 0.

    Raises
    ------
    MissingExtraError
        If python-can or, for MF4, asammdf is not installed.
    """

    def __init__(self, path: Path) -> None:
        # In this order: asammdf, when it comes first, hides itself from python-can.
        _require("can", "python-can", path, "can")
        if path.suffix.lower() == ".mf4":
            _require("asammdf", "asammdf", path, "mf4")
        self.path = path
        self.torn = 0

    def __iter__(self) -> Iterator[Message]:
        """Yield the messages of the log.

        Raises
        ------
        DataError
            At a line or record that does not hold a frame.
        """
        with _Lines(self.path) if self._is_text() else self.path.open("rb") as file:
            try:
                reader = self._reader(file)
                yield from self._messages(reader)
                self._judge(reader, file)
            except _cannot_read() as error:
                raise DataError(
                    f"this does not hold CAN frames ({error or type(error).__name__})",
                    where=f"{self.path}:{file.number}"
                    if isinstance(file, _Lines)
                    else f"{self.path}",
                    next_step="remove the line, or convert the log to candump's format with the"
                    " program that wrote it",
                ) from error

    def _is_text(self) -> bool:
        return self.path.suffix.lower() in TEXTS

    def _reader(self, file: _Lines | BinaryIO) -> MessageReader:
        import can

        if isinstance(file, _Lines):
            if self.path.suffix.lower() == ".asc":
                return can.ASCReader(file, relative_timestamp=False)
            return (can.TRCReader if self.path.suffix.lower() == ".trc" else can.CSVReader)(file)
        if self.path.suffix.lower() == ".blf":
            return can.BLFReader(file)
        if file.read(len(MDF)) != MDF:
            raise ValueError("this is not an MDF file")
        return can.MF4Reader(self.path)  # from an open file it would read everything at once

    def _messages(self, reader: MessageReader) -> Iterator[Message]:
        try:
            yield from reader
        except struct.error:
            if self._is_text():
                raise
            self.torn = 1  # a record without its end
        finally:
            reader.stop()

    def _judge(self, reader: MessageReader, file: _Lines | BinaryIO) -> None:
        """Look, at the end, for what python-can does not tell."""
        import can

        if isinstance(file, _Lines):
            self.torn = file.torn
        elif isinstance(reader, can.BLFReader) and reader.file_size != self.path.stat().st_size:
            # A program that died left the size unwritten; half a BLF has the size of the whole.
            self.torn = 1
        if getattr(reader, "timestamps_format", None) == "relative":
            raise ValueError("its stamps count from one frame to the next")


class _Lines(TextIOWrapper):
    """A text that knows which line was read last, and hides a last line without an end.

    Attributes
    ----------
    number : int
        Of the last line that was read, from 1.
    torn : int
        1 if the last line had no end.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path.open("rb"), encoding="utf-8", errors="replace")
        self.number = 0
        self.torn = 0

    def __next__(self) -> str:
        line = super().__next__()
        self.number += 1
        if line.endswith("\n") or line.strip().lower() == LAST_OF_ASC:
            return line
        self.torn = 1
        raise StopIteration


def _cannot_read() -> tuple[type[Exception], ...]:
    """Return what python-can and asammdf raise for a file that they cannot read."""
    from can.io.blf import BLFParseError

    errors = [ValueError, LookupError, TypeError, NotImplementedError, struct.error, zlib.error]
    asammdf = sys.modules.get("asammdf.blocks.utils")
    return (*errors, BLFParseError, *([] if asammdf is None else [asammdf.MdfException]))


def _require(module: str, package: str, path: Path, extra: str) -> None:
    try:
        import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"{path.suffix} logs are read by the package {package}, which is not installed",
            where=str(path),
            next_step=f"type: pip install 'comcal[{extra}]'",
        ) from error
