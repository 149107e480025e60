# SPDX-License-Identifier: Apache-2.0
"""The server's side of the socketcand protocol in raw mode, as a pure state machine.

Messages are ``< words >`` without a separator between them. Source: linux-can/socketcand,
doc/protocol.md and state_raw.c (payload bytes of a frame follow each other without a space,
errors come without payload, remote requests not at all).
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame

GREETING = b"< hi >"
LONGEST_MESSAGE = 256


def socketcand_message(frame: Frame) -> bytes:
    """Return a received frame as the server reports it; nothing for a remote request."""
    bare = frame.id & ~EXTENDED
    if frame.kind == ERROR:
        return f"< error {bare:03X} {frame.t:.6f} >".encode("ascii")
    if frame.kind == REMOTE:
        return b""
    word = f"{bare:08X}" if frame.id & EXTENDED else f"{bare:03X}"
    return f"< frame {word} {frame.t:.6f} {frame.data.hex().upper()} >".encode("ascii")


@dataclass
class SocketcandSession:
    """What the server remembers of one client.

    Parameters
    ----------
    buses : tuple of str
        Names that may be opened.
    bus : str
        The one that is; empty before.
    is_raw : bool
        Whether frames are passed on.
    """

    buses: tuple[str, ...]
    bus: str = ""
    is_raw: bool = False
    _text: str = ""

    def feed(self, received: bytes) -> tuple[bytes, list[Frame]]:
        """Take bytes of the client.

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
        self._text += received.decode("latin-1")
        answers = bytearray()
        frames = list[Frame]()
        while (end := self._text.find(">")) >= 0:
            message, self._text = self._text[:end], self._text[end + 1 :]
            answers += self._obey(message.partition("<")[2].split(), frames)
        self._text = self._text[-LONGEST_MESSAGE:]
        return bytes(answers), frames

    def _obey(self, words: list[str], frames: list[Frame]) -> bytes:
        if len(words) == 2 and words[0] == "open" and not self.bus:
            if words[1] not in self.buses:
                return b"< error could not open bus >"
            self.bus = words[1]
            return b"< ok >"
        if words == ["rawmode"] and self.bus:
            self.is_raw = True
            return b"< ok >"
        if words == ["echo"]:
            return b"< echo >"
        if len(words) >= 3 and words[0] == "send" and self.is_raw:
            frame = _sent_frame(words[1:])
            if frame is not None:
                frames.append(frame)
                return b""
        return b"< error unknown command >"


def _sent_frame(words: list[str]) -> Frame | None:
    """Return the frame of ``send ID LENGTH BYTE BYTE ...``, or None if it is not one."""
    try:
        identifier, length = int(words[0], 16), int(words[1], 16)
        data = bytes(int(word, 16) for word in words[2:])
    except ValueError:
        return None
    is_extended = len(words[0]) > 3
    if length != len(data) or length > 8 or identifier > (0x1FFFFFFF if is_extended else 0x7FF):
        return None
    return Frame(identifier | (EXTENDED if is_extended else 0), data)
