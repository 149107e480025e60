# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from itertools import pairwise

import can
import numpy as np
import pytest
from can.interfaces.socketcand import socketcand as theirs
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal_drivers.bus.error_frames import bus_off_rows
from comcal_drivers.bus.socketcand_lines import LONGEST, SocketcandLines, socketcand_line
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.messages import pack

COLUMNS = ("t", "ids", "lengths", "data", "kinds")


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    extended = draw(st.booleans())
    return can.Message(
        timestamp=draw(st.integers(0, 2 * 10**15)) / 1e6,
        arbitration_id=draw(st.integers(0, (1 << (29 if extended else 11)) - 1)),
        is_extended_id=extended,
        data=draw(st.binary(max_size=8)),
    )


def reported(message: can.Message) -> bytes:
    number = f"{message.arbitration_id:0{8 if message.is_extended_id else 3}X}"
    return f"< frame {number} {message.timestamp:.6f} {message.data.hex().upper()} >".encode()


@settings(max_examples=60)
@given(st.lists(messages(), max_size=6), st.lists(st.integers(0, 1000), max_size=5))
def test_frames_are_those_of_an_independent_implementation_however_the_text_is_cut(sent, cuts):
    text = b"".join(map(reported, sent))
    edges = [0, *sorted(cut % (len(text) + 1) for cut in cuts), len(text)]
    lines = SocketcandLines()
    read = concatenate([lines.feed(text[a:b]) for a, b in pairwise(edges)])
    expected = pack(theirs.convert_ascii_message_to_can_message(reported(m).decode()) for m in sent)
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(read, column), getattr(expected, column))
    assert lines.garbage == 0


@settings(max_examples=40)
@given(messages())
def test_a_sent_message_says_the_same_as_an_independent_implementation(message):
    def words(text: str) -> list[int]:
        return [int(word, 16) for word in text.split()[2:-1]]

    ours = socketcand_line(message).decode()
    independent = theirs.convert_can_message_to_ascii_message(message)
    assert words(ours) == words(independent)
    assert ours.split()[2] == independent.split()[2]


def test_error_frames_carry_their_class():
    batch = SocketcandLines().feed(b"< error 20000040 12.500000 >< error 004 12.6 >")
    assert bus_off_rows(batch).tolist() == [True, False]
    assert batch.t.tolist() == [12.5, 12.6]


@pytest.mark.parametrize(
    "text",
    [
        b"< frame 800 1.0 00 >",
        b"< frame 20000000 1.0 00 >",
        b"< frame 12 1.0 00 >",
        b"< frame 123 1.0 0 >",
        b"< frame 123 1.0 000000000000000000 >",
        b"< frame 123 x 00 >",
        b"< bus 1 >",
        b"7" * 10_000 + b">",
    ],
)
def test_what_is_no_frame_is_dropped_and_counted_and_the_next_is_read(text):
    lines = SocketcandLines()
    assert lines.feed(text + b"< frame 123 1.0 AA >").ids.tolist() == [0x123]
    assert lines.garbage == 1


def test_an_endless_message_takes_no_memory():
    lines = SocketcandLines()
    for _ in range(100):
        lines.feed(b"7" * 1000)
    assert len(lines._tail) <= LONGEST


@pytest.mark.parametrize("kind", ["is_remote_frame", "is_error_frame", "is_fd"])
def test_what_the_protocol_does_not_know_is_refused(kind):
    with pytest.raises(ValueError, match="classic"):
        socketcand_line(can.Message(**{kind: True}))
