# SPDX-License-Identifier: Apache-2.0
"""Texts that wait for a file descriptor which takes them piecemeal."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

_CHUNK = 4096


class Outbox:
    """A queue of texts, written out without blocking and never torn in between.

    Parameters
    ----------
    write : callable
        Takes bytes, returns how many of them it took; raises BlockingIOError where none.
    """

    def __init__(self, write: Callable[[bytes], int]) -> None:
        self._write = write
        self._texts = deque[bytes]()
        self._begun = b""

    def __len__(self) -> int:
        return len(self._texts) + bool(self._begun)

    def put(self, text: bytes) -> None:
        """Append one text; empty ones are nothing."""
        if text:
            self._texts.append(text)

    def clear(self) -> None:
        """Forget everything but the rest of a text that was begun."""
        self._texts.clear()

    def flush(self) -> None:
        """Write as much as is taken now.

        Raises
        ------
        OSError
            As the writer does, but for what means "later".
        """
        while self._begun or self._texts:
            pieces, size = [self._begun], len(self._begun)
            while self._texts and size < _CHUNK:
                pieces.append(self._texts.popleft())
                size += len(pieces[-1])
            self._begun = b"".join(pieces)
            try:
                taken = self._write(self._begun)
            except BlockingIOError:
                return
            self._begun = self._begun[taken:]
