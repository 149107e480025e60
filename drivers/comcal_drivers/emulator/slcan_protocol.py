# SPDX-License-Identifier: Apache-2.0
"""The adapter's side of the serial-line CAN protocol of Lawicel, as a pure state machine.

Commands are lines ended by CR; the answer is CR (done), BEL (refused) or a line. A channel is
closed at power-up and speaks only while it is open.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame

OK, REFUSED = b"\r", b"\a"
VERSION, SERIAL_NUMBER = b"V1013\r", b"NC0C0\r"
LONGEST_LINE = 64

RX_FULL, TX_FULL, OVERRUN, BUS_ERROR = 0x01, 0x02, 0x08, 0x80
"""Bits of the answer to ``F``, which clears them."""

_STAMP_PERIOD = 60_000
_DATA = re.compile(r"(?:t([0-9A-F]{3})|T([0-9A-F]{8}))([0-8])((?:[0-9A-F]{2})*)\Z", re.IGNORECASE)
_REMOTE = re.compile(r"(?:r([0-9A-F]{3})|R([0-9A-F]{8}))([0-8])\Z", re.IGNORECASE)


def slcan_line(frame: Frame, *, stamped: bool = False) -> bytes:
    """Return a received frame as the adapter reports it; nothing for an error frame.

    Parameters
    ----------
    frame : Frame
    stamped : bool
        Append the time in milliseconds modulo one minute, as after ``Z1``.
    """
    if frame.kind == ERROR:
        return b""
    bare = frame.id & ~EXTENDED
    letter = "r" if frame.kind == REMOTE else "t"
    head = f"{letter.upper()}{bare:08X}" if frame.id & EXTENDED else f"{letter}{bare:03X}"
    data = "" if frame.kind == REMOTE else frame.data.hex().upper()
    stamp = f"{round(frame.t * 1e3) % _STAMP_PERIOD:04X}" if stamped else ""
    return f"{head}{len(frame.data)}{data}{stamp}\r".encode("ascii")


@dataclass
class SlcanChannel:
    """What one adapter remembers between two bytes.

    Parameters
    ----------
    is_open : bool
        Whether the host opened the channel.
    listens_only : bool
        Opened with ``L``: it sends nothing to the bus.
    stamped : bool
        Whether lines carry time stamps.
    flags : int
        What ``F`` answers next.
    bitrate : bytes
        The last ``S`` or ``s`` command.
    """

    is_open: bool = False
    listens_only: bool = False
    stamped: bool = False
    flags: int = 0
    bitrate: bytes = b""
    _line: bytearray = field(default_factory=bytearray)
    _too_long: bool = False

    def feed(self, received: bytes) -> tuple[bytes, list[Frame]]:
        """Take bytes of the host.

        Parameters
        ----------
        received : bytes
            Any piece of what it writes, cut anywhere.

        Returns
        -------
        answers : bytes
            To be written back, in order.
        frames : list of Frame
            To be sent to the bus.
        """
        answers = bytearray()
        frames = list[Frame]()
        for byte in received:
            if byte != 0x0D:
                if byte == 0x0A:  # some hosts end their lines with CR LF
                    continue
                if len(self._line) < LONGEST_LINE:
                    self._line.append(byte)
                else:
                    self._too_long = True
                continue
            line, refused = self._line.decode("latin-1"), self._too_long
            self._line.clear()
            self._too_long = False
            if refused:
                answers += REFUSED
            elif line:
                answers += self._obey(line, frames)
            else:
                answers += OK
        return bytes(answers), frames

    def _obey(self, line: str, frames: list[Frame]) -> bytes:
        command = line[0]
        if command in "tTrR":
            return self._transmit(line, frames)
        if line == "V":
            return VERSION
        if line == "N":
            return SERIAL_NUMBER
        if line == "F":
            answer = f"F{self.flags:02X}\r".encode("ascii")
            self.flags = 0
            return answer if self.is_open else REFUSED
        if line == "C":
            was_open, self.is_open, self.listens_only = self.is_open, False, False
            return OK if was_open else REFUSED
        if self.is_open:
            return REFUSED
        return self._set_up(line)

    def _set_up(self, line: str) -> bytes:
        """Obey what only a closed channel does."""
        if line in ("O", "L"):
            self.is_open, self.listens_only = True, line == "L"
        elif line in ("Z0", "Z1"):
            self.stamped = line == "Z1"
        elif re.fullmatch(r"S[0-9]|s[0-9A-Fa-f]{4}(?:[0-9A-Fa-f]{2})?", line):
            self.bitrate = line.encode("ascii")
        else:
            return REFUSED
        return OK

    def _transmit(self, line: str, frames: list[Frame]) -> bytes:
        found = _DATA.match(line) or _REMOTE.match(line)
        if found is None or not self.is_open or self.listens_only:
            return REFUSED
        short, long, size = found.group(1, 2, 3)
        is_remote = line[0] in "rR"
        data = bytes(int(size)) if is_remote else bytes.fromhex(found.group(4))
        identifier = int(short or long, 16)
        if len(data) != int(size) or identifier > (0x7FF if short else 0x1FFFFFFF):
            return REFUSED
        flag = 0 if short else EXTENDED
        frames.append(Frame(identifier | flag, data, kind=REMOTE if is_remote else 0))
        return b"z\r" if short else b"Z\r"
