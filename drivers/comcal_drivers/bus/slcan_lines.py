# SPDX-License-Identifier: Apache-2.0
"""Text of serial-line CAN adapters (slcan, "Lawicel" protocol) to frames and back.

One line a frame, ended by carriage return: ``t1232AABB`` (11-bit identifier 123, 2 bytes),
``T00000123...`` (29 bits), ``r1234`` and ``R...`` (remote requests), ``d D b B`` (CAN FD), each
with four digits of milliseconds behind it when the adapter was told ``Z1``. Newer firmware
also reports its state, ``sb256256`` (bus-off, error counters), and errors, ``e2ac``, as the
kernel's slcan driver understands them. Empty lines and a bell answer commands; ``F08`` answers
``F`` by what went wrong since it was asked last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from comcal_drivers.bus import error_frames as errors
from comcal_drivers.bus.text_rows import TextRows
from comcal_drivers.frames.batch import EXTENDED, FD, REMOTE, FrameBatch

if TYPE_CHECKING:
    from can import Message

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Payload bytes of each of the sixteen length codes of CAN FD; the first nine are classic CAN."""

LONGEST = 160
"""More characters than any line that means something."""

STAMP_PERIOD = 60.0
"""The adapter's clock starts anew every minute [s]."""

# First character: digits of the identifier, bits of it, kind, whether the payload follows.
_FRAMES: dict[bytes, tuple[int, int, int, bool]] = {
    b"t": (3, 0, 0, True),
    b"T": (8, int(EXTENDED), 0, True),
    b"x": (8, int(EXTENDED), 0, True),
    b"r": (3, 0, int(REMOTE), False),
    b"R": (8, int(EXTENDED), int(REMOTE), False),
    b"d": (3, 0, int(FD), True),
    b"b": (3, 0, int(FD), True),
    b"D": (8, int(EXTENDED), int(FD), True),
    b"B": (8, int(EXTENDED), int(FD), True),
}
_ANSWERS = (b"z", b"Z", b"V", b"v", b"N")
# Bits of the answer to F, what happened since it was asked last: class, data[1].
_FLAGS = {
    0x01: (errors.CONTROLLER, errors.RECEIVE_OVERFLOW),
    0x02: (errors.CONTROLLER, errors.SEND_OVERFLOW),
    0x04: (errors.CONTROLLER, errors.WARNING),
    0x08: (errors.CONTROLLER, errors.RECEIVE_OVERFLOW),
    0x20: (errors.CONTROLLER, errors.PASSIVE),
    0x80: (errors.PROTOCOL | errors.BUS_ERROR, 0),
}
_STATES = {
    b"a": (errors.CONTROLLER, errors.ACTIVE),
    b"w": (errors.CONTROLLER, errors.WARNING),
    b"p": (errors.CONTROLLER, errors.PASSIVE),
    b"b": (errors.BUS_OFF, 0),
}
# Letter of an error: class, index of the payload byte, bits in it.
_ERRORS = {
    "a": (errors.ACKNOWLEDGE, 3, 0x19),
    "b": (0, 2, 0x08),
    "B": (0, 2, 0x10),
    "c": (0, 3, 0x08),
    "f": (0, 2, 0x02),
    "o": (errors.CONTROLLER, 1, errors.RECEIVE_OVERFLOW),
    "O": (errors.CONTROLLER, 1, errors.SEND_OVERFLOW),
    "s": (0, 2, 0x04),
}


class SlcanLines:
    """Makes frames of an adapter's bytes, however these are cut.

    A line that is not what the protocol allows, to the last digit, is dropped whole and counted:
    serial lines have no checksum, so nothing is guessed. It keeps at most :data:`LONGEST`
    characters.
    """

    def __init__(self) -> None:
        self._tail = b""
        self._clock: tuple[float, int] | None = None
        self.garbage = 0
        """Lines that were dropped."""
        self.refusals = 0
        """Commands that the adapter answered with a bell."""
        self.answers = 0
        """Commands that it answered at all."""

    def feed(self, received: bytes, now: float) -> FrameBatch:
        """Return the frames that are complete with these bytes.

        Parameters
        ----------
        received : bytes
        now : float
            When they came [s since 1970]; the stamp of their frames, unless the adapter sends its
            own, which are then laid on this clock where the first of them came.

        Returns
        -------
        FrameBatch
        """
        self.refusals += received.count(b"\a")
        lines = (self._tail + received).replace(b"\a", b"\r").split(b"\r")
        # A line that is too long stays too long: its beginning is enough to refuse it by.
        self._tail = lines.pop()[:LONGEST]
        rows = TextRows()
        for piece in lines:
            line = piece.lstrip(b"\n")  # some adapters end lines by two characters
            if not self._read_frame(line, now, rows):
                self._read_other(line, now, rows)
        return rows.batch()

    def _read_frame(self, line: bytes, now: float, rows: TextRows) -> bool:
        layout = _FRAMES.get(line[:1])
        # int() takes spaces, signs and underscores; digits and letters alone are let through.
        if layout is None or not line.isalnum() or len(line) >= LONGEST:
            return False
        digits, bits, kind, has_payload = layout
        body = digits + 2
        try:
            int(line[1:], 16)
            number = int(line[1 : digits + 1], 16)
            length = int(line[digits + 1 : body], 16)
        except ValueError:
            return False
        if length > 8 and not kind & FD:
            return False
        length = FD_LENGTHS[length]
        end = body + 2 * length * has_payload
        rest = len(line) - end
        if number >> (29 if bits else 11) or rest not in (0, 4):
            return False
        t = self._stamp(int(line[end:], 16), now) if rest else now
        rows.append(t, number | bits, length, line[body:end], kind)
        return True

    def _stamp(self, milliseconds: int, now: float) -> float:
        if self._clock is None:
            self._clock = (now, milliseconds)
        t0, first = self._clock
        since = (milliseconds - first) / 1000.0
        # The whole minutes are those that bring it nearest to this computer's clock.
        return t0 + since + STAMP_PERIOD * round((now - t0 - since) / STAMP_PERIOD)

    def _read_other(self, line: bytes, now: float, rows: TextRows) -> None:
        if not line or (line[:1] in _ANSWERS and line.isalnum()) or _read_flags(line, now, rows):
            self.answers += 1
        elif not (_read_state(line, now, rows) or _read_errors(line, now, rows)):
            self.garbage += 1


def _read_flags(line: bytes, now: float, rows: TextRows) -> bool:
    if line[:1] != b"F" or len(line) != 3 or not line.isalnum():
        return False
    try:
        flags = int(line[1:], 16)
    except ValueError:
        return False
    classes, problem = 0, 0
    for bit, (more, bits) in _FLAGS.items():
        if flags & bit:
            classes |= more
            problem |= bits
    if classes:
        rows.append_error(now, classes, (0, problem))
    return True


def _read_state(line: bytes, now: float, rows: TextRows) -> bool:
    state = _STATES.get(line[1:2])
    if line[:1] != b"s" or state is None or len(line) != 8 or not line[2:].isdigit():
        return False
    received, sent = int(line[2:5]), int(line[5:8])
    rows.append_error(now, state[0], (0, state[1], 0, 0, 0, 0, min(sent, 255), min(received, 255)))
    return True


def _read_errors(line: bytes, now: float, rows: TextRows) -> bool:
    letters = line[2:].decode("latin-1")
    if line[:1] != b"e" or line[1:2] != str(len(letters)).encode() or not letters:
        return False
    if not set(letters) <= _ERRORS.keys():
        return False
    classes, payload = errors.PROTOCOL | errors.BUS_ERROR, [0] * 8
    for letter in letters:
        more, index, bits = _ERRORS[letter]
        classes |= more
        payload[index] |= bits
    rows.append_error(now, classes, tuple(payload))
    return True


def slcan_line(message: Message) -> bytes:
    """Return the command that sends a message.

    Parameters
    ----------
    message : can.Message

    Returns
    -------
    bytes
        With the carriage return.

    Raises
    ------
    ValueError
        Error frames cannot be sent.
    """
    if message.is_error_frame:
        raise ValueError("an error frame cannot be sent")
    letter = "r" if message.is_remote_frame else "t"
    length = message.dlc
    if message.is_fd:
        letter = "b" if message.bitrate_switch else "d"
        length = FD_LENGTHS.index(message.dlc)
    number = f"{message.arbitration_id:03X}"
    if message.is_extended_id:
        letter, number = letter.upper(), f"{message.arbitration_id:08X}"
    payload = "" if message.is_remote_frame else bytes(message.data).hex().upper()
    return f"{letter}{number}{length:X}{payload}\r".encode("ascii")
