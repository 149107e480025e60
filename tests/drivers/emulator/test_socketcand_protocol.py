# SPDX-License-Identifier: Apache-2.0
"""The socketcand protocol, checked against python-can's own parser and however bytes are cut."""

from __future__ import annotations

from itertools import pairwise

import can
import pytest
from can.interfaces.socketcand.socketcand import (
    convert_ascii_message_to_can_message,
    convert_can_message_to_ascii_message,
)
from hypothesis import given
from hypothesis import strategies as st

from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame
from comcal_drivers.emulator.socketcand_protocol import SocketcandSession, socketcand_message

RAW = b"< open can0 >< rawmode >"


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"< open can0 >", b"< ok >"),
        (b"< open can9 >", b"< error could not open bus >"),
        (RAW, b"< ok >< ok >"),
        (b"< rawmode >", b"< error unknown command >"),
        (b"< echo >", b"< echo >"),
        (b"< send 123 0 >", b"< error unknown command >"),  # not in raw mode
        (RAW + b"< send 123 2 1 ff >", b"< ok >< ok >"),
        (RAW + b"< send 123 2 1 >", b"< ok >< ok >< error unknown command >"),
        (RAW + b"< send 800 0 >", b"< ok >< ok >< error unknown command >"),
    ],
)
def test_every_command_is_answered_as_the_protocol_says(sent: bytes, answered: bytes) -> None:
    assert SocketcandSession(("can0",)).feed(sent)[0] == answered


IDS = st.one_of(st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda i: i | EXTENDED))


@given(IDS, st.binary(max_size=8), st.integers(0, 10**9))
def test_the_client_reads_what_is_written(identifier: int, data: bytes, micros: int) -> None:
    frame = Frame(identifier, data, micros / 1e6)
    read = convert_ascii_message_to_can_message(socketcand_message(frame).decode())
    assert (read.arbitration_id, read.is_extended_id) == (frame.bare_id, identifier >= EXTENDED)
    assert bytes(read.data) == data
    assert read.timestamp == pytest.approx(micros / 1e6, abs=1e-6)


def test_error_frames_are_told_and_remote_requests_are_not() -> None:
    read = convert_ascii_message_to_can_message(
        socketcand_message(Frame(0x40, bytes(8), kind=ERROR)).decode()
    )
    assert read.is_error_frame
    assert read.arbitration_id == 0x40
    assert socketcand_message(Frame(0x123, kind=REMOTE)) == b""


@given(st.lists(st.tuples(IDS, st.binary(max_size=8)), max_size=5), st.lists(st.integers(0, 300)))
def test_what_the_client_sends_arrives_whole_wherever_it_is_cut(
    sent: list[tuple[int, bytes]], cuts: list[int]
) -> None:
    messages = [
        can.Message(
            arbitration_id=i & ~EXTENDED, is_extended_id=bool(i & EXTENDED), data=d, dlc=len(d)
        )
        for i, d in sent
    ]
    text = RAW + b"".join(convert_can_message_to_ascii_message(m).encode() for m in messages)
    edges = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    session = SocketcandSession(("can0",))
    got = [f for a, b in pairwise(edges) for f in session.feed(text[a:b])[1]]
    assert [(f.id, f.data) for f in got] == sent
