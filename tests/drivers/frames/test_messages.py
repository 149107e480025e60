# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal_drivers.frames.batch import ERROR, EXTENDED, FD, REMOTE, SENT, FrameBatch
from comcal_drivers.frames.batches import concatenate, take, to_microseconds
from comcal_drivers.frames.messages import pack, to_messages

Messages = Callable[..., list[can.Message]]
Same = Callable[[FrameBatch, FrameBatch], None]


def test_messages_come_back_as_they_were(messages: Messages) -> None:
    sent = messages(300)
    back = list(to_messages(pack(sent), "can0"))
    assert len(back) == 300
    for found, expected in zip(back, sent, strict=True):
        assert found.equals(expected, timestamp_delta=0.0), (found, expected)


def test_every_attribute_has_its_place() -> None:
    batch = pack(
        [
            can.Message(1.5, 0x123, is_extended_id=False, data=b"\x01\x02"),
            can.Message(2.5, 0x123, is_extended_id=True, is_rx=False, data=b""),
            can.Message(3.5, 0x7FF, is_extended_id=False, is_remote_frame=True, dlc=5),
            can.Message(4.5, 0x40, is_extended_id=True, is_error_frame=True, data=bytes(8)),
            can.Message(5.5, 0x123, is_extended_id=False, is_fd=True, data=bytes(range(12))),
        ]
    )
    assert batch.t.tolist() == [1.5, 2.5, 3.5, 4.5, 5.5]
    assert batch.ids.tolist() == [0x123, 0x123 | int(EXTENDED), 0x7FF, 0x40, 0x123]
    assert batch.lengths.tolist() == [2, 0, 5, 8, 12]
    assert batch.kinds.tolist() == [0, SENT, REMOTE, ERROR, FD]
    assert batch.data.shape == (5, 64)
    assert batch.data[0, :3].tolist() == [1, 2, 0]
    assert batch.data[4, :13].tolist() == [*range(12), 0]


@given(st.lists(st.integers(0, 50), max_size=6))
def test_cutting_and_joining_gives_the_stream_back(
    messages: Messages, assert_same: Same, cuts: list[int]
) -> None:
    batch = pack(messages(50))
    edges = [0, *sorted(cuts), 50]
    parts = [take(batch, slice(a, b)) for a, b in pairwise(edges)]
    assert_same(concatenate(parts), batch)
    whole = messages(50)
    packed = [pack(whole[a:b]) for a, b in pairwise(edges)]
    assert_same(concatenate(packed), batch)


def test_no_messages_are_an_empty_batch() -> None:
    for batch in (pack([]), concatenate([])):
        assert len(batch) == 0
        assert batch.data.shape == (0, 8)
        assert list(to_messages(batch)) == []


@given(st.integers(0, 4 * 10**15))
def test_stamps_on_the_microsecond_are_kept_to_the_last_bit(microseconds: int) -> None:
    t = float(f"{microseconds // 10**6}.{microseconds % 10**6:06d}")
    assert to_microseconds(np.array([t]))[0] == t
    assert abs(to_microseconds(np.array([t + 2.4e-7]))[0] - t) <= 1e-6


def test_a_frame_without_stamp_is_zero_for_python_can() -> None:
    batch = take(pack([can.Message(1.0)]), slice(0, 1))
    none = FrameBatch(batch.t * np.nan, batch.ids, batch.lengths, batch.data, batch.kinds)
    assert next(to_messages(none)).timestamp == pytest.approx(0.0, abs=0.0)
