# SPDX-License-Identifier: Apache-2.0
"""Read the logs that CAN tools write, as batches of frames."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from comcal.errors import DataError, UsageError
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate, take
from comcal_drivers.frames.candump import dialect_of, read_text
from comcal_drivers.frames.messages import pack
from comcal_drivers.frames.other_logs import ENDINGS, OtherLog

CHUNK = 100_000

TEXTS = (".log", ".txt", ".candump")
"""Endings of candump's own texts."""


def read_log(path: Path | str, chunk: int = CHUNK, *, channel: str | None = None) -> LogReader:
    """Open a log of CAN frames.

    Parameters
    ----------
    path : path
        ``.log``, ``.txt``, ``.candump``: what ``candump -L`` and python-can write, or the text
        that candump shows, with or without stamps. ``.asc``, ``.blf``, ``.trc``, ``.csv``,
        ``.mf4``: the formats of Vector, PEAK, python-can and ASAM.
    chunk : int
        Largest number of frames of a batch.
    channel : str, optional
        Only frames of this interface, in the log's own word for it; default all.

    Returns
    -------
    LogReader
        An iterator of :class:`~comcal_drivers.frames.batch.FrameBatch`, none of them empty.

    Raises
    ------
    UsageError
        If the file is missing or cannot be read, or its ending is none of these.
    DataError
        At once or while iterating: a line (``file:line``) or record does not hold a frame.
    MissingExtraError
        If python-can or, for MF4, asammdf is not installed.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (*TEXTS, *ENDINGS):
        raise UsageError(
            f"a CAN log with the ending {path.suffix!r} is not known",
            where=str(path),
            next_step=f"known are: {', '.join((*TEXTS, *ENDINGS))}",
        )
    try:
        with path.open("rb"):
            pass
        dialect = dialect_of(path) if ending in TEXTS else None
    except OSError as error:
        raise UsageError(
            f"the log cannot be read: {error.strerror}",
            where=str(path),
            next_step="name an existing file",
        ) from error
    if ending in ENDINGS:
        return LogReader(OtherLog(path), path, chunk, channel)
    if dialect is None:
        raise DataError(
            "none of the first lines holds a CAN frame",
            where=f"{path}:1",
            next_step="log with candump -L",
        )
    return LogReader(dialect, path, chunk, channel)


class LogReader(Iterator[FrameBatch]):
    """Frames of a log, batch by batch.

    Attributes
    ----------
    path : Path
    channels : Counter
        Frames seen so far of every interface, whether asked for or not.
    """

    def __init__(
        self, log: OtherLog | re.Pattern[bytes], path: Path, chunk: int, channel: str | None
    ) -> None:
        self.path = path
        self.channels: Counter[str] = Counter()
        self._torn = 0
        self._log = log
        self._channel = channel
        self._chunk = max(1, chunk)
        parts = self._of_messages(log) if isinstance(log, OtherLog) else self._of_text(log)
        self._batches = _in_chunks(parts, self._chunk)

    @property
    def torn(self) -> int:
        """1 once the end is reached of a log whose writer died while it wrote; else 0.

        What it had not written to its end is lost: one frame of a text, more of a BLF.
        """
        return self._log.torn if isinstance(self._log, OtherLog) else self._torn

    def __iter__(self) -> LogReader:
        return self

    def __next__(self) -> FrameBatch:
        return next(self._batches)

    def _of_text(self, dialect: re.Pattern[bytes]) -> Iterator[FrameBatch]:
        for piece in read_text(self.path, dialect):
            self._torn += piece.torn
            counts = np.bincount(piece.channel, minlength=len(piece.channels)).tolist()
            self.channels.update(dict(zip(piece.channels, counts, strict=True)))
            if self._channel is None:
                yield piece.batch
            elif self._channel in piece.channels:
                wanted = piece.channel == piece.channels.index(self._channel)
                yield take(piece.batch, wanted)

    def _of_messages(self, log: OtherLog) -> Iterator[FrameBatch]:
        messages = iter(log)
        while some := list(islice(messages, self._chunk)):
            names = ["" if m.channel is None else str(m.channel) for m in some]
            self.channels.update(names)
            wanted = zip(some, names, strict=True)
            yield pack(m for m, name in wanted if self._channel in (None, name))


def _in_chunks(batches: Iterable[FrameBatch], chunk: int) -> Iterator[FrameBatch]:
    """Cut the stream anew, into batches of *chunk* frames and a last one."""
    waiting: list[FrameBatch] = []
    frames = 0
    for batch in batches:
        waiting.append(batch)
        frames += len(batch)
        if frames < chunk:
            continue
        joined = concatenate(waiting)
        begin = 0
        while frames - begin >= chunk:
            yield take(joined, slice(begin, begin + chunk))
            begin += chunk
        waiting, frames = [take(joined, slice(begin, None))], frames - begin
    if frames:
        yield concatenate(waiting)
