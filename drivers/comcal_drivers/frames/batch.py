# SPDX-License-Identifier: Apache-2.0
"""Consecutive frames of one bus as columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

EXTENDED = np.uint32(1 << 31)
"""Set in ``ids`` for 29-bit identifiers, as cantools and SocketCAN number them."""

ERROR, REMOTE, FD, SENT = (np.uint8(1 << k) for k in range(4))
"""Bits of ``kinds``: error frame, remote request, CAN FD, sent by this program."""


@dataclass(frozen=True)
class FrameBatch:
    """Consecutive frames of one bus, in the order in which they came.

    Parameters
    ----------
    t : array, shape (n,)
        Time stamps as the interface or the log gives them [s], rounded to a microsecond, the
        resolution of text logs; NaN where it gives none.
    ids : array of uint32, shape (n,)
        Identifiers; :data:`EXTENDED` is set for those of 29 bits. Of an error frame: its class,
        as SocketCAN numbers them (0x40: bus off).
    lengths : array of uint8, shape (n,)
        Payload bytes that were received; of a remote request: those that it asks for.
    data : array of uint8, shape (n, 8) or (n, 64)
        Payload, zero beyond ``lengths``.
    kinds : array of uint8, shape (n,)
        Bits :data:`ERROR`, :data:`REMOTE`, :data:`FD`, :data:`SENT`.
    """

    t: npt.NDArray[np.float64]
    ids: npt.NDArray[np.uint32]
    lengths: npt.NDArray[np.uint8]
    data: npt.NDArray[np.uint8]
    kinds: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return int(self.t.size)
