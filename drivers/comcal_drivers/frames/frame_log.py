# SPDX-License-Identifier: Apache-2.0
"""Write frames as they come, so that nothing that was written is lost when the program dies."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from types import TracebackType

import numpy as np

from comcal.errors import ConfigError, HardwareError
from comcal_drivers.frames.batch import ERROR, EXTENDED, FD, REMOTE, SENT, FrameBatch
from comcal_drivers.frames.candump import ERROR_FLAG, dialect_of
from comcal_drivers.frames.shapes import LOG, NO_STAMP

LARGEST_TAIL = 1 << 20
"""Bytes at the end of a log in which its last whole line is looked for."""

SYNC_PERIOD = 0.5
"""Shortest time between two requests that the disk keep what was written [s]."""


class FrameLog:
    """An appending log in the format of ``candump -L``.

    What :meth:`write` was given is with the operating system when it returns, and survives the
    death of this program. A thread asks the disk to keep it, at most every :data:`SYNC_PERIOD`, so
    that a slow disk does not keep the reader of a bus waiting; only a power cut can cost that much.

    A line that a killed program left without its end is cut off when the log is opened: it is no
    frame, and would spoil the first line that is appended.

    Parameters
    ----------
    path : path
        Created when it is not there; its folder must be.

    Attributes
    ----------
    path : Path
    cut : bytes
        The piece of a line that was cut off at the end of the file; mostly empty.

    Raises
    ------
    HardwareError
        If the file cannot be opened.
    ConfigError
        If it holds something else than a log.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        try:
            is_other = self.path.is_file() and dialect_of(self.path) is not LOG
            if not is_other:
                self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise self._failed("opened", error) from error
        if is_other:
            raise ConfigError(
                "the file is not a log in the format of candump -L, nothing is appended to it",
                where=str(self.path),
                next_step="name another file",
            )
        try:
            self._size = os.fstat(self._file).st_size
            self.cut = self._cut_torn_line()
            _sync_folder(self.path.parent)
        except OSError as error:
            os.close(self._file)
            raise self._failed("opened", error) from error
        self._lock = threading.Lock()
        self._failure: OSError | None = None
        self._is_dirty = threading.Event()
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._keep_synced, name="frame log", daemon=True)
        self._thread.start()

    def write(self, batch: FrameBatch, channel: str) -> None:
        """Append the frames of a batch.

        Several threads may write to one log; batches are not mixed.

        Parameters
        ----------
        batch : FrameBatch
            Stamps are written with microseconds. A frame without one gets ``-0.000000``, which
            other programs read as zero and :func:`~comcal_drivers.frames.logs.read_log` as NaN.
        channel : str
            Name of the interface, without blanks.

        Raises
        ------
        HardwareError
            If the disk is full or gone. Of this batch nothing is in the log then, and a later
            attempt may succeed.
        """
        text = to_text(batch, channel)
        with self._lock:
            if self._failure is not None:
                error, self._failure = self._failure, None
                raise self._failed("kept by the disk", error) from error
            if self._is_closed.is_set():
                raise ValueError(f"{self.path} is closed")
            rest = memoryview(text)
            try:
                while rest:
                    rest = rest[os.write(self._file, rest) :]
            except OSError as error:
                os.ftruncate(self._file, self._size)
                raise self._failed("written", error) from error
            self._size += len(text)
        self._is_dirty.set()

    def close(self) -> None:
        """Have the disk keep everything, and close the file; harmless when repeated.

        Raises
        ------
        HardwareError
            If the disk cannot.
        """
        with self._lock:
            if self._is_closed.is_set():
                return
            self._is_closed.set()
        self._is_dirty.set()
        self._thread.join()
        try:
            os.fsync(self._file)
        except OSError as error:
            self._failure = self._failure or error
        os.close(self._file)
        if self._failure is not None:
            raise self._failed("kept by the disk", self._failure) from self._failure

    def __enter__(self) -> FrameLog:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _keep_synced(self) -> None:
        while not self._is_closed.is_set():
            self._is_dirty.wait()
            self._is_dirty.clear()
            try:
                os.fsync(self._file)
            except OSError as error:
                self._failure = error
            self._is_closed.wait(SYNC_PERIOD)

    def _cut_torn_line(self) -> bytes:
        # A power cut may leave zeros where the disk never got the text: longer than any line.
        begin = max(0, self._size - LARGEST_TAIL)
        tail = os.pread(self._file, self._size - begin, begin)
        whole = tail.rfind(b"\n") + 1
        torn = tail[whole:]
        if torn:
            self._size = begin + whole
            os.ftruncate(self._file, self._size)
        return torn

    def _failed(self, done: str, error: OSError) -> HardwareError:
        return HardwareError(
            f"the frame log cannot be {done}: {error.strerror}",
            where=str(self.path),
            next_step="make room on the disk, or name another folder",
        )


def to_text(batch: FrameBatch, channel: str) -> bytes:
    """Return frames in the format of ``candump -L``.

    Parameters
    ----------
    batch : FrameBatch
    channel : str
        Name of the interface.

    Returns
    -------
    bytes
        A line for each frame. Sent ones end with `` T``.

    Raises
    ------
    ConfigError
        If *channel* is empty or has blanks.
    """
    if channel.split() != [channel]:
        raise ConfigError(
            "the name of a bus must be one word to stand in a log",
            where=f"bus {channel!r}",
            next_step="rename it in robot.yaml",
        )
    if not len(batch):
        return b""
    none = NO_STAMP.decode()
    digits = np.ascontiguousarray(batch.data).tobytes().hex().upper()
    width = 2 * batch.data.shape[1]
    lines: list[str] = []
    rows = zip(
        batch.t.tolist(),
        batch.ids.tolist(),
        batch.lengths.tolist(),
        batch.kinds.tolist(),
        strict=True,
    )
    for row, (t, number, length, kind) in enumerate(rows):
        stamp = f"{t:017.6f}" if t == t else none
        payload = digits[row * width : row * width + 2 * length]
        if kind:
            if kind & _ERROR:
                number |= _ERROR_FLAG | _EXTENDED
            if kind & _REMOTE:
                payload = f"R{length}" if length else "R"
            elif kind & _FD:
                payload = f"#0{payload}"
            if kind & _SENT:
                payload += " T"
        name = f"{number - _EXTENDED:08X}" if number >= _EXTENDED else f"{number:03X}"
        lines.append(f"({stamp}) {channel} {name}#{payload}\n")
    return "".join(lines).encode()


_ERROR, _REMOTE, _FD, _SENT = int(ERROR), int(REMOTE), int(FD), int(SENT)
_EXTENDED, _ERROR_FLAG = int(EXTENDED), int(ERROR_FLAG)


def _sync_folder(folder: Path) -> None:
    """Have the disk keep the name of a new file, too."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
