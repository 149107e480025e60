# SPDX-License-Identifier: Apache-2.0
"""The serial-line protocol, command by command, and however the bytes are cut."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame
from comcal_drivers.emulator.slcan_protocol import BUS_ERROR, SlcanChannel, slcan_line

DATA = Frame(0x201, bytes([0xC8, 0, 0x10, 0x27, 0, 0]))


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"V\r", b"V1013\r"),
        (b"N\r", b"NC0C0\r"),
        (b"S8\r", b"\r"),
        (b"s1C2B\r", b"\r"),
        (b"Z1\r", b"\r"),
        (b"O\r", b"\r"),
        (b"L\r", b"\r"),
        (b"\r", b"\r"),
        (b"C\r", b"\a"),  # not open
        (b"F\r", b"\a"),
        (b"t2011FF\r", b"\a"),
        (b"Q\r", b"\a"),
        (b"S\r", b"\a"),
        (b"O\rO\r", b"\r\a"),
        (b"O\rS8\r", b"\r\a"),
        (b"O\rF\r", b"\rF00\r"),
        (b"O\rC\r", b"\r\r"),
        (b"O\rt2011FF\r", b"\rz\r"),
        (b"O\rT000002010\r", b"\rZ\r"),
        (b"O\rr2010\r", b"\rz\r"),
        (b"L\rt2010\r", b"\r\a"),
        (b"O\rt2012FF\r", b"\r\a"),  # one byte is missing
        (b"O\rt8000\r", b"\r\a"),  # more than 11 bits
        (b"O\rT200000000\r", b"\r\a"),  # more than 29 bits
        (b"x" * 1000 + b"\r", b"\a"),
    ],
)
def test_every_command_is_answered_as_the_protocol_says(sent: bytes, answered: bytes) -> None:
    assert SlcanChannel().feed(sent)[0] == answered


def test_the_bus_error_flag_is_told_once() -> None:
    channel = SlcanChannel(is_open=True, flags=BUS_ERROR)
    assert channel.feed(b"F\rF\r")[0] == b"F80\rF00\r"


@pytest.mark.parametrize(
    ("frame", "line"),
    [
        (DATA, b"t2016C80010270000\r"),
        (Frame(0x7F0), b"t7F00\r"),
        (Frame(0x901 | EXTENDED, b"\xff"), b"T000009011FF\r"),
        (Frame(0x123, bytes(4), kind=REMOTE), b"r1234\r"),
        (Frame(0x1F001234 | EXTENDED, b"", kind=REMOTE), b"R1F0012340\r"),
        (Frame(0x40, bytes(8), kind=ERROR), b""),
    ],
)
def test_frames_are_written_as_the_protocol_says(frame: Frame, line: bytes) -> None:
    assert slcan_line(frame) == line


def test_stamps_are_milliseconds_of_the_minute() -> None:
    assert slcan_line(Frame(0x7F0, t=61.5), stamped=True) == b"t7F0005DC\r"


SHORT, LONG = st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda i: i | EXTENDED)
IDS, PAYLOADS = st.one_of(SHORT, LONG), st.binary(max_size=8)
FRAMES = st.one_of(
    st.tuples(IDS, PAYLOADS).map(lambda made: Frame(*made)),
    st.tuples(IDS, st.integers(0, 8)).map(lambda made: Frame(made[0], bytes(made[1]), kind=REMOTE)),
)


@given(st.lists(FRAMES, max_size=6), st.lists(st.integers(0, 200), max_size=6))
def test_frames_arrive_whole_wherever_the_bytes_are_cut(
    frames: list[Frame], cuts: list[int]
) -> None:
    text = b"S8\rO\r" + b"".join(map(slcan_line, frames))
    edges = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    channel = SlcanChannel()
    got = [f for a, b in pairwise(edges) for f in channel.feed(text[a:b])[1]]
    assert got == frames
