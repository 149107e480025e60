# SPDX-License-Identifier: Apache-2.0
"""Collects frames that come as hexadecimal text and makes columns of them at once."""

from __future__ import annotations

import numpy as np

from comcal_drivers.bus.error_frames import error_frame
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import CLASSIC, LONG, concatenate, to_microseconds


class TextRows:
    """Frames in the order in which they were read.

    Appending costs a few list operations; arrays are made once per batch.
    """

    def __init__(self) -> None:
        self._done: list[FrameBatch] = []
        self._clear()

    def _clear(self) -> None:
        self._t: list[float] = []
        self._ids: list[int] = []
        self._lengths: list[int] = []
        self._payloads: list[bytes] = []
        self._kinds: list[int] = []

    def append(self, t: float, number: int, length: int, payload: bytes, kind: int) -> None:
        """Add a frame.

        Parameters
        ----------
        t : float
            Time stamp [s].
        number : int
            Identifier, with ``EXTENDED`` where it has 29 bits.
        length : int
            Payload bytes (of a remote request: those asked for).
        payload : bytes
            Two hexadecimal digits a byte, checked by the caller.
        kind : int
            Bits of ``FrameBatch.kinds``.
        """
        self._t.append(t)
        self._ids.append(number)
        self._lengths.append(length)
        self._payloads.append(payload)
        self._kinds.append(kind)

    def append_error(self, t: float, classes: int, payload: tuple[int, ...]) -> None:
        """Add an error frame; see :func:`~comcal_drivers.bus.error_frames.error_frame`."""
        self._flush()
        self._done.append(error_frame(t, classes, payload))

    def batch(self) -> FrameBatch:
        """Return all of them.

        Returns
        -------
        FrameBatch
            64 columns of data where a payload is longer than 8 bytes.
        """
        self._flush()
        return concatenate(self._done)

    def _flush(self) -> None:
        n = len(self._ids)
        if n == 0:
            return
        width = CLASSIC if max(map(len, self._payloads)) <= 2 * CLASSIC else LONG
        digits = b"".join([payload.ljust(2 * width, b"0") for payload in self._payloads])
        data = np.frombuffer(bytes.fromhex(digits.decode("ascii")), np.uint8)
        self._done.append(
            FrameBatch(
                t=to_microseconds(np.array(self._t, np.float64)),
                ids=np.array(self._ids, np.uint32),
                lengths=np.array(self._lengths, np.uint8),
                data=data.reshape(n, width),
                kinds=np.array(self._kinds, np.uint8),
            )
        )
        self._clear()
