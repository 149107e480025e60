# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import can
import numpy as np
import pytest

from comcal_drivers.bus.error_frames import (
    BUS_OFF,
    PROTOCOL,
    RESTARTED,
    error_frame,
    gap_marker,
    is_bus_off_after,
    is_gap,
)
from comcal_drivers.bus.watch import Watch
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.frame_log import FrameLog
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import pack, to_messages


def data_frame(number: int = 0x40, payload: bytes = b"\0\1") -> object:
    return pack([can.Message(arbitration_id=number, is_extended_id=False, data=payload)])


@pytest.mark.parametrize(
    ("after", "is_off"),
    [
        (error_frame(1.0, BUS_OFF), True),
        (concatenate([data_frame(), error_frame(1.0, BUS_OFF)]), True),
        (concatenate([error_frame(1.0, BUS_OFF), error_frame(1.0, RESTARTED)]), False),
        (concatenate([error_frame(1.0, BUS_OFF), data_frame()]), False),
        (error_frame(1.0, PROTOCOL), False),
    ],
)
@pytest.mark.parametrize("before", [False, True])
def test_the_last_frame_decides_whether_the_controller_is_off_the_bus(before, after, is_off):
    assert is_bus_off_after(after, before) == is_off


@pytest.mark.parametrize("before", [False, True])
def test_neither_silence_nor_our_own_mark_changes_whether_it_is_off(before):
    assert is_bus_off_after(concatenate(()), before) == before
    assert is_bus_off_after(gap_marker(1.0), before) == before


def test_data_frames_are_never_taken_for_marks():
    assert not is_gap(data_frame(0x004)).any()
    assert is_gap(gap_marker(1.0)).all()


def test_the_mark_of_a_gap_survives_the_log_and_python_can(tmp_path):
    stream = concatenate([data_frame(), gap_marker(2.0), data_frame()])
    with FrameLog(tmp_path / "x.log") as log:
        log.write(stream, "can0")
    logged = concatenate(read_log(tmp_path / "x.log"))
    for copy in (logged, pack(to_messages(stream))):
        assert is_gap(copy).tolist() == [False, True, False]
        np.testing.assert_array_equal(copy.data, stream.data)


def test_silence_is_counted_once_and_ends_with_the_next_frame():
    watch = Watch(silence_after=0.5, now=0.0)
    nothing, something = concatenate(()), data_frame()
    for now in (0.1, 0.4, 0.6, 0.9, 2.0):
        watch.see(nothing, now, now)
    assert (watch.silences, watch.is_silent) == (1, True)
    watch.see(something, 2.1, 2.1)
    assert (watch.silences, watch.is_silent, watch.last_seen) == (1, False, 2.1)
    watch.see(nothing, 2.7, 2.7)
    assert watch.silences == 2


def test_error_frames_alone_are_silence():
    watch = Watch(silence_after=0.5, now=0.0)
    for now in (0.2, 0.4, 0.6):
        watch.see(error_frame(now, PROTOCOL), now, now)
    assert (watch.frames, watch.error_frames, watch.is_silent) == (0, 3, True)


def test_bus_off_is_seen_and_ends_when_frames_come_again():
    watch = Watch(silence_after=0.5, now=0.0)
    watch.see(concatenate([data_frame(), error_frame(1.0, BUS_OFF)]), 0.1, 1.0)
    assert (watch.bus_off, watch.bus_offs) == (True, 1)
    watch.see(data_frame(), 0.2, 1.1)
    assert (watch.bus_off, watch.bus_offs) == (False, 1)
