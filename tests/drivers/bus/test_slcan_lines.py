# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from itertools import pairwise

import can
import numpy as np
import pytest
from can.interfaces.slcan import slcanBus
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal_drivers.bus.error_frames import bus_off_rows, is_gap
from comcal_drivers.bus.slcan_lines import LONGEST, SlcanLines, slcan_line
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.messages import pack, to_messages

COLUMNS = ("t", "ids", "lengths", "data", "kinds")


@st.composite
def messages(draw: st.DrawFn, fd: bool = True) -> can.Message:
    extended = draw(st.booleans())
    remote = draw(st.booleans())
    is_fd = fd and not remote and draw(st.booleans())
    size = draw(st.sampled_from([0, 1, 7, 8, 12, 64] if is_fd else range(9)))
    return can.Message(
        timestamp=2.0,
        arbitration_id=draw(st.integers(0, (1 << (29 if extended else 11)) - 1)),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=is_fd,
        dlc=size,
        data=None if remote else draw(st.binary(min_size=size, max_size=size)),
    )


def pieces(text: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(text) + 1) for cut in cuts), len(text)]
    return [text[a:b] for a, b in pairwise(edges)]


def assert_equal(ours, theirs) -> None:
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(ours, column), getattr(theirs, column))


@settings(max_examples=60)
@given(st.lists(messages(), max_size=8), st.lists(st.integers(0, 1000), max_size=5))
def test_frames_come_back_however_the_text_is_cut(sent, cuts):
    lines = SlcanLines()
    text = b"".join(map(slcan_line, sent))
    read = concatenate([lines.feed(piece, 2.0) for piece in pieces(text, cuts)])
    assert_equal(read, pack(sent))
    assert lines.garbage == 0


@settings(max_examples=60)
@given(st.binary(max_size=300), st.lists(st.integers(0, 1000), max_size=5))
def test_garbage_gives_the_same_frames_and_counts_however_it_is_cut(text, cuts):
    whole, cut = SlcanLines(), SlcanLines()
    expected = whole.feed(text, 2.0)
    assert_equal(concatenate([cut.feed(piece, 2.0) for piece in pieces(text, cuts)]), expected)
    assert (cut.garbage, cut.refusals, cut.answers) == (
        whole.garbage,
        whole.refusals,
        whole.answers,
    )


@settings(max_examples=40)
@given(st.text("0123456789abcdefABCDEFtTrRdDxzse \n_+-", max_size=40))
def test_what_is_read_from_garbage_is_what_it_says(text):
    """Whatever is accepted must give the very same line back."""
    for message in to_messages(SlcanLines().feed(text.encode() + b"\r", 2.0)):
        if message.is_error_frame:
            continue
        line = slcan_line(message).decode().strip().lower()
        said = text.lstrip("\n").lower()
        assert (said[0].replace("x", "t").replace("b", "d") + said[1:])[: len(line)] == line


@pytest.mark.parametrize(
    "line",
    [
        b"t12",
        b"t8001" + b"00",  # 12 bits of identifier
        b"T200000000",  # 30 bits
        b"t1239" + b"00" * 9,
        b"t1232AA",  # a byte short
        b"t1232AABBC",  # half a byte more
        b"t1232AA+B",
        b"t1232AA B",
        b"t12_0",
        b"t123g",
        b"r12",
        b"r1230AA",
        b"q1230",
        b"sb2562",
        b"e3ab",
        b"e1q",
        b"t1230" + b"0" * LONGEST,
    ],
)
def test_a_line_that_is_not_allowed_is_dropped_and_counted_and_the_next_is_read(line):
    lines = SlcanLines()
    batch = lines.feed(line + b"\rt1231AA\r", 2.0)
    assert lines.garbage == 1
    assert batch.ids.tolist() == [0x123]
    assert batch.data[0, 0] == 0xAA


def test_lines_may_end_with_two_characters():
    lines = SlcanLines()
    assert lines.feed(b"t1230\r\nt1240\r\n\r\n", 2.0).ids.tolist() == [0x123, 0x124]
    assert lines.garbage == 0


def test_an_endless_line_takes_no_memory_and_is_one_piece_of_garbage():
    lines = SlcanLines()
    for _ in range(100):
        assert len(lines.feed(b"7" * 1000, 2.0)) == 0
    assert len(lines._tail) <= LONGEST
    assert lines.feed(b"t1230\rt1240\r", 2.0).ids.tolist() == [0x124]
    assert lines.garbage == 1


def test_answers_and_refusals_are_no_frames_and_no_garbage():
    lines = SlcanLines()
    assert len(lines.feed(b"\r\az\rZ\rV1013\rNA123\rF00\r", 2.0)) == 0
    assert (lines.answers, lines.refusals, lines.garbage) == (7, 1, 0)


def test_the_clock_of_the_adapter_is_followed_over_the_full_minute():
    lines = SlcanLines()
    milliseconds = [59_990, 59_999, 4, 30_000, 10, 59_000]
    arrivals = [1000.0, 1000.02, 1000.03, 1030.1, 1060.2, 1120.0]
    t = concatenate(
        [
            lines.feed(b"t1230%04X\r" % stamp, now)
            for stamp, now in zip(milliseconds, arrivals, strict=True)
        ]
    ).t
    np.testing.assert_allclose(
        t, 1000.0 + np.array([0.0, 0.009, 0.014, 30.010, 60.020, 119.010]), atol=1e-6
    )


def test_bus_off_and_overruns_that_newer_firmware_reports_become_error_frames():
    lines = SlcanLines()
    batch = lines.feed(b"t1230\rsb256255\re2ao\rsa000000\rt1240\r", 2.0)
    assert bus_off_rows(batch).tolist() == [False, True, False, False, False]
    assert is_gap(batch).tolist() == [False, False, True, False, False]
    assert batch.data[1, 6:8].tolist() == [255, 255]
    assert batch.ids[[0, 4]].tolist() == [0x123, 0x124]


@pytest.mark.parametrize(
    ("answer", "is_lost", "classes"),
    [(b"F01", True, 0x04), (b"F08", True, 0x04), (b"F20", False, 0x04), (b"F80", False, 0x88)],
)
def test_what_the_adapter_tells_of_itself_becomes_an_error_frame(answer, is_lost, classes):
    batch = SlcanLines().feed(answer + b"\r", 2.0)
    assert batch.ids.tolist() == [classes]
    assert is_gap(batch).tolist() == [is_lost]


class _Wire:
    """Stands for the serial port of python-can's own slcan bus."""

    write_timeout = None

    def __init__(self) -> None:
        self.written = b""

    def write(self, text: bytes) -> None:
        self.written += text

    def flush(self) -> None:
        pass


@settings(max_examples=40)
@given(messages())
def test_lines_are_those_of_an_independent_implementation(message):
    bus = slcanBus.__new__(slcanBus)
    bus._is_shutdown = True
    bus.serialPortOrig = _Wire()
    bus.send(message)
    assert slcan_line(message) == bus.serialPortOrig.written
    assert_equal(SlcanLines().feed(bus.serialPortOrig.written, 2.0), pack([message]))


def test_an_error_frame_cannot_be_sent():
    with pytest.raises(ValueError, match="error frame"):
        slcan_line(can.Message(is_error_frame=True))
