# SPDX-License-Identifier: Apache-2.0
"""The reader in the background: nothing lost silently, nothing hangs."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from comcal.errors import HardwareError
from comcal_drivers.bus import reader as reading
from comcal_drivers.bus.error_frames import BUS_OFF, bus_off_rows, error_frame, is_gap
from comcal_drivers.bus.reader import BusReader
from comcal_drivers.devices.configuration import BusConfig
from comcal_drivers.frames.batch import SENT
from comcal_drivers.frames.batches import concatenate, take
from comcal_drivers.frames.frame_log import FrameLog
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import to_messages

VIRTUAL = BusConfig("can0", "virtual", "test_reader")


@pytest.fixture
def far_end() -> Iterator[can.BusABC]:
    bus = can.Bus(interface="virtual", channel=VIRTUAL.channel)
    yield bus
    bus.shutdown()


@pytest.fixture
def log(tmp_path) -> Iterator[FrameLog]:
    with FrameLog(tmp_path / "frames.log") as file:
        yield file


def send_all(bus: can.BusABC, batch) -> None:
    for message in to_messages(batch):
        bus.send(message)


def test_what_is_taken_is_what_was_logged_to_the_last_bit(far_end, log, frames, numbers, collect):
    with BusReader(VIRTUAL, log) as reader:
        send_all(far_end, frames(300))
        live = collect(reader, 300)
        assert reader.health().frames == 300
    assert numbers(live) == list(range(300))
    logged = concatenate(read_log(log.path))
    for column in ("t", "ids", "lengths", "data", "kinds"):
        np.testing.assert_array_equal(getattr(logged, column), getattr(live, column))


def test_frames_are_in_the_log_before_they_are_handed_over(far_end, frames):
    class SlowLog:
        def __init__(self) -> None:
            self.written = 0

        def write(self, batch, channel) -> None:
            time.sleep(0.02)
            self.written += len(batch)

    log, taken = SlowLog(), 0
    with BusReader(VIRTUAL, log) as reader:
        for k in range(10):
            send_all(far_end, frames(20, 20 * k))
            taken += len(reader.take(0.01))
            assert taken <= log.written


def test_the_log_of_what_was_read_is_complete_after_closing(far_end, log, frames, numbers, until):
    reader = BusReader(VIRTUAL, log)
    send_all(far_end, frames(500))
    until(lambda: reader.health().frames == 500)
    reader.close()
    assert numbers(concatenate(read_log(log.path))) == list(range(500))
    assert numbers(reader.take()) == list(range(500))


def test_sent_messages_stand_in_the_stream_before_their_answers(far_end, log, collect):
    def answer() -> None:
        for _ in range(50):
            request = far_end.recv(2.0)
            far_end.send(
                can.Message(
                    arbitration_id=request.arbitration_id + 1,
                    is_extended_id=False,
                    data=request.data,
                )
            )

    peer = threading.Thread(target=answer)
    peer.start()
    with BusReader(VIRTUAL, log) as reader:
        for k in range(50):
            reader.send(can.Message(arbitration_id=0x20, is_extended_id=False, data=[k]))
        stream = collect(reader, 100)
        assert reader.health().sent == 50
    peer.join(5.0)
    is_sent = (stream.kinds & SENT) != 0
    assert set(stream.ids[is_sent]) == {0x20}
    rows = [
        [int(np.flatnonzero((stream.data[:, 0] == k) & own)[0]) for own in (is_sent, ~is_sent)]
        for k in range(50)
    ]
    assert all(request < answer for request, answer in rows)
    logged = concatenate(read_log(log.path))
    np.testing.assert_array_equal(logged.kinds, stream.kinds)


def test_a_message_that_cannot_be_sent_is_an_error_and_not_in_the_log(frames, until, log):
    class Deaf(can.BusABC):
        def __init__(self) -> None:
            super().__init__("deaf")

        def _recv_internal(self, timeout):
            time.sleep(timeout or 0.0)
            return None, False

        def send(self, msg, timeout=None):
            raise can.CanOperationError("Transmit buffer full")

    with BusReader(VIRTUAL, log, opener=lambda _: Deaf()) as reader:
        with pytest.raises(HardwareError, match=r"20 cannot be sent.*buffer full.*acknowledges"):
            reader.send(can.Message(arbitration_id=0x20, is_extended_id=False))
        assert reader.health().sent == 0
    assert len(concatenate(read_log(log.path))) == 0


def test_frames_that_nobody_takes_are_counted_marked_and_still_logged(
    far_end, log, frames, numbers, until
):
    with BusReader(VIRTUAL, log, queue_limit=50) as reader:
        for k in range(20):
            send_all(far_end, frames(10, 10 * k))
            until(lambda k=k: reader.health().frames == 10 * (k + 1))
            time.sleep(0.005)
        until(lambda: reader.health().dropped_by_queue == 150)
        stream = reader.take()
        assert is_gap(stream).tolist() == [True] + 50 * [False]
        assert numbers(take(stream, ~is_gap(stream))) == list(range(150, 200))
        assert reader.health().lost == 150
    assert numbers(concatenate(read_log(log.path))) == list(range(200))


def test_a_log_that_is_too_slow_costs_counted_frames_and_no_memory(far_end, frames, until):
    gate = threading.Event()

    class StuckLog:
        def write(self, batch, channel) -> None:
            gate.wait(5.0)

    with BusReader(VIRTUAL, StuckLog(), queue_limit=50) as reader:
        send_all(far_end, frames(1))
        time.sleep(0.05)
        send_all(far_end, frames(200, 1))
        until(lambda: reader.health().lost_before_log == 150)
        gate.set()
        until(lambda: len(reader.take(0.05)))


def test_silence_is_noticed_and_its_end(far_end, frames, until):
    with BusReader(VIRTUAL, silence_after=0.1) as reader:
        assert np.isnan(reader.health().last_seen)
        until(lambda: reader.health().is_silent)
        send_all(far_end, frames(1))
        until(lambda: not reader.health().is_silent)
        assert abs(reader.health().last_seen - time.time()) < 1.0
        until(lambda: reader.health().silences == 2)


def test_bus_off_is_noticed_and_that_the_controller_came_back(far_end, frames, until, collect):
    with BusReader(VIRTUAL) as reader:
        send_all(far_end, error_frame(1.0, BUS_OFF))
        until(lambda: reader.health().bus_off)
        assert bus_off_rows(collect(reader, 1)).all()
        send_all(far_end, frames(1))
        until(lambda: not reader.health().bus_off)
        health = reader.health()
        assert (health.bus_offs, health.error_frames, health.frames) == (1, 1, 1)


def test_bus_off_is_noticed_on_a_serial_adapter_and_on_a_daemon(
    adapter, serial_bus, daemon, daemon_bus, until
):
    with BusReader(serial_bus) as serial, BusReader(daemon_bus) as remote:
        until(lambda: daemon.client is not None)
        adapter.say(b"sb256256\r")
        daemon.say(b"< error 20000040 1.0 >")
        until(lambda: serial.health().bus_off and remote.health().bus_off)


def test_an_adapter_that_is_pulled_out_is_found_again(
    adapter, serial_bus, log, numbers, collect, until
):
    with BusReader(serial_bus, log) as reader:
        adapter.number(0, 20)
        before = collect(reader, 20)
        adapter.unplug()
        until(lambda: not reader.health().is_connected)
        assert "gone" in reader.health().exception
        with pytest.raises(HardwareError, match="device is away"):
            reader.send(can.Message(arbitration_id=1))
        time.sleep(0.2)
        adapter.plug_in()
        until(lambda: reader.health().is_connected)
        adapter.number(50, 60)
        after = collect(reader, 11)
        assert reader.health().reconnects == 1
    assert numbers(before) == list(range(20))
    assert is_gap(after).tolist() == [True] + 10 * [False], "what was missed is marked"
    assert numbers(after)[1:] == list(range(50, 60))
    assert is_gap(concatenate(read_log(log.path))).sum() == 1


def test_a_daemon_that_hangs_up_is_called_again(daemon, daemon_bus, collect, until):
    with BusReader(daemon_bus) as reader:
        for k in range(3):
            until(lambda: daemon.client is not None)
            daemon.say(b"< frame 123 1.0 %02X >" % k)
            stream = collect(reader, 1 + (k > 0))
            assert stream.data[-1, 0] == k
            daemon.hang_up()
            until(lambda k=k: reader.health().reconnects == k + 1)


def test_closing_while_the_device_is_away_takes_no_time(adapter, serial_bus, until):
    reader = BusReader(serial_bus)
    adapter.unplug()
    until(lambda: not reader.health().is_connected)
    began = time.monotonic()
    reader.close()
    assert time.monotonic() - began < 1.0
    assert not reader._receiver.is_alive()
    assert not reader._writer.is_alive()


class FullDisk:
    def __init__(self, after: int) -> None:
        self.room = after
        self.written = 0

    def write(self, batch, channel) -> None:
        if self.written + len(batch) > self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.written += len(batch)


def test_a_full_disk_is_an_error_and_nothing_is_accepted_after(far_end, frames, until):
    log = FullDisk(after=25)
    reader = BusReader(VIRTUAL, log)
    send_all(far_end, frames(10))
    until(lambda: len(reader.take(0.05)) or log.written == 10)
    send_all(far_end, frames(40, 10))
    until(lambda: not reader._writer.is_alive())
    for _ in range(2):
        with pytest.raises(HardwareError, match=r"No space left.*make room"):
            reader.take()
    with pytest.raises(HardwareError, match="No space left"):
        reader.send(can.Message(arbitration_id=1))
    written = log.written
    send_all(far_end, frames(5, 50))
    time.sleep(0.1)
    assert log.written == written
    assert "No space" in reader.health().exception
    reader.close()


def test_a_disk_that_is_full_at_the_end_is_told_by_closing(far_end, frames, until):
    log = FullDisk(after=0)
    reader = BusReader(VIRTUAL, log)
    send_all(far_end, frames(1))
    until(lambda: not reader._writer.is_alive())
    with pytest.raises(HardwareError, match="No space left"):
        reader.close()


def test_an_unexpected_error_in_the_background_is_raised_by_the_next_call(until):
    class Broken(can.BusABC):
        def __init__(self) -> None:
            super().__init__("broken")

        def _recv_internal(self, timeout):
            raise ZeroDivisionError("in the driver")

        def send(self, msg, timeout=None):
            pass

    reader = BusReader(VIRTUAL, opener=lambda _: Broken())
    until(lambda: not reader._receiver.is_alive())
    with pytest.raises(ZeroDivisionError, match="in the driver"):
        reader.take()
    reader.close()


def test_a_driver_that_hangs_cannot_hang_the_program(monkeypatch):
    monkeypatch.setattr(reading, "CLOSE_TIME", 0.2)
    release = threading.Event()

    class Stuck(can.BusABC):
        def __init__(self) -> None:
            super().__init__("stuck")

        def _recv_internal(self, timeout):
            release.wait(10.0)
            return None, False

        def send(self, msg, timeout=None):
            pass

    reader = BusReader(VIRTUAL, opener=lambda _: Stuck())
    began = time.monotonic()
    with pytest.raises(HardwareError, match="does not close"):
        reader.close()
    assert time.monotonic() - began < 2.0
    release.set()
    reader._receiver.join(5.0)


def test_a_bus_that_cannot_be_opened_is_told_by_the_constructor(tmp_path):
    with pytest.raises(HardwareError, match="plug the adapter in"):
        BusReader(BusConfig("can0", "slcan", str(tmp_path / "none"), 500_000))


def test_the_pause_before_trying_again_grows_up_to_a_limit(monkeypatch, until):
    monkeypatch.setattr(reading, "FIRST_PAUSE", 0.02)
    monkeypatch.setattr(reading, "LONGEST_PAUSE", 0.08)
    tries: list[float] = []

    class Gone(can.BusABC):
        def __init__(self) -> None:
            super().__init__("gone")

        def _recv_internal(self, timeout):
            raise can.CanOperationError("gone")

        def send(self, msg, timeout=None):
            pass

    def opener(_: BusConfig) -> can.BusABC:
        tries.append(time.monotonic())
        if len(tries) > 1:
            raise HardwareError("still away")
        return Gone()

    with BusReader(VIRTUAL, opener=opener) as reader:
        until(lambda: len(tries) >= 6)
        assert "still away" in reader.health().exception
    pauses = np.diff(tries)
    assert (pauses >= [0.02, 0.02, 0.04, 0.08, 0.08][: len(pauses[:5])] - np.full(5, 2e-3)).all()


def test_many_seconds_of_traffic_come_through_a_serial_line_without_loss(
    adapter, serial_bus, log, numbers, collect, until: Callable
):
    with BusReader(serial_bus, log) as reader:
        parts = []
        for k in range(0, 4000, 100):
            adapter.number(k, k + 100)
            parts.append(reader.take())
        parts.append(collect(reader, 4000 - sum(map(len, parts))))
        health = reader.health()
    assert numbers(concatenate(parts)) == list(range(4000))
    assert (health.garbage, health.lost, health.silences) == (0, 0, 0)
