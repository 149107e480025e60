# SPDX-License-Identifier: Apache-2.0
"""Text of the socketcand protocol in raw mode to frames and back.

``< frame 123 1700000000.000123 11223344 >`` is a frame (eight digits of identifier: 29 bits),
``< error 20000040 1700000000.000123 >`` an error frame, whose payload is not sent.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from comcal_drivers.bus.text_rows import TextRows
from comcal_drivers.frames.batch import EXTENDED, FrameBatch

if TYPE_CHECKING:
    from can import Message

LONGEST = 400
"""More characters than any message that means something."""

_MESSAGE = re.compile(
    rb"< (frame|error) ([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8}) (\d+\.\d+) ?([0-9A-Fa-f ]*)>"
)
_ERROR_CLASSES = 0x1FFFFFFF


class SocketcandLines:
    """Makes frames of what the daemon sends, however that is cut.

    What is no frame is dropped and counted. It keeps at most :data:`LONGEST` characters.
    """

    def __init__(self) -> None:
        self._tail = b""
        self.garbage = 0
        """Messages that were dropped."""

    def feed(self, received: bytes) -> FrameBatch:
        """Return the frames that are complete with these bytes.

        Parameters
        ----------
        received : bytes

        Returns
        -------
        FrameBatch
            Stamps are the daemon's.
        """
        pieces = (self._tail + received).split(b">")
        self._tail = pieces.pop()[:LONGEST]
        rows = TextRows()
        for piece in pieces:
            if not _read(piece.lstrip() + b">", rows):
                self.garbage += 1
        return rows.batch()


def _read(message: bytes, rows: TextRows) -> bool:
    match = _MESSAGE.fullmatch(message)
    if match is None:
        return False
    kind, digits, stamp, payload = match.groups()
    number, t = int(digits, 16), float(stamp)
    if kind == b"error":
        rows.append_error(t, number & _ERROR_CLASSES, ())
        return True
    payload = payload.replace(b" ", b"")
    is_extended = len(digits) == 8
    if number >> (29 if is_extended else 11) or len(payload) % 2 or len(payload) > 16:
        return False
    rows.append(t, number | (int(EXTENDED) if is_extended else 0), len(payload) // 2, payload, 0)
    return True


def socketcand_line(message: Message) -> bytes:
    """Return the command that sends a message.

    Parameters
    ----------
    message : can.Message

    Returns
    -------
    bytes

    Raises
    ------
    ValueError
        The protocol sends neither error frames nor remote requests nor CAN FD.
    """
    if message.is_error_frame or message.is_remote_frame or message.is_fd:
        raise ValueError("socketcand sends classic data frames only")
    number = f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}"
    payload = " ".join(f"{byte:02X}" for byte in message.data)
    return f"< send {number} {message.dlc} {payload} >".encode("ascii")
