# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import threading
import time

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal_drivers.bus.error_frames import is_gap
from comcal_drivers.bus.frame_queue import MOST_BATCHES, FrameQueue
from comcal_drivers.frames.batches import take


@settings(max_examples=60)
@given(data=st.data())
def test_every_frame_is_taken_once_in_order_or_counted_as_dropped(frames, numbers, data):
    queue, limit = FrameQueue(20), 20
    put, taken, gaps = 0, [], 0
    for step in data.draw(st.lists(st.integers(0, 30), max_size=12)):
        if step:
            queue.put(frames(step, put))
            put += step
        else:
            batch = queue.take()
            marks = is_gap(batch)
            gaps += int(marks.sum())
            assert not marks[1:].any(), "the gap is where the oldest frames were"
            taken += numbers(take(batch, ~marks))
        assert len(queue) <= limit
    rest = queue.take()
    taken += numbers(take(rest, ~is_gap(rest)))
    assert len(taken) + queue.dropped == put
    assert taken == sorted(set(taken))
    assert (gaps > 0 or is_gap(rest).any()) == (queue.dropped > 0)


def test_many_small_batches_are_kept_as_few(frames, numbers):
    queue = FrameQueue(100_000)
    for k in range(3 * MOST_BATCHES):
        queue.put(frames(1, k))
    assert len(queue._slots) <= MOST_BATCHES
    assert numbers(queue.take()) == list(range(3 * MOST_BATCHES))


def test_an_answer_is_never_before_its_request(frames, numbers):
    queue = FrameQueue(100)
    queue.put(frames(1, 0))
    request = queue.reserve(frames(1, 1))
    queue.put(frames(1, 2))
    assert numbers(queue.take()) == [0]
    assert len(queue.take()) == 0
    queue.settle(request, keep=True)
    assert numbers(queue.take()) == [1, 2]


def test_a_request_that_failed_leaves_no_trace(frames, numbers):
    queue = FrameQueue(100)
    request = queue.reserve(frames(1, 1))
    queue.put(frames(1, 2))
    queue.settle(request, keep=False)
    assert len(queue) == 1
    assert numbers(queue.take()) == [2]


def test_waiting_ends_with_frames_with_time_and_with_the_queue(frames):
    queue = FrameQueue(100)
    threading.Timer(0.05, queue.put, [frames(1)]).start()
    assert len(queue.take(5.0)) == 1
    began = time.monotonic()
    assert len(queue.take(0.05)) == 0
    assert 0.04 < time.monotonic() - began < 1.0
    threading.Timer(0.05, queue.close).start()
    began = time.monotonic()
    assert len(queue.take(5.0)) == 0
    assert time.monotonic() - began < 1.0


def test_what_is_held_can_be_taken_after_closing(frames):
    queue = FrameQueue(100)
    queue.put(frames(3))
    queue.close()
    assert len(queue.take(1.0)) == 3


def test_stamp_of_the_gap_is_that_of_the_newest_frame_that_is_missing(frames):
    queue = FrameQueue(2)
    queue.put(frames(5))
    batch = queue.take()
    assert is_gap(batch).tolist() == [True, False, False]
    np.testing.assert_allclose(batch.t[0], frames(5).t[2])
