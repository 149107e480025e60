# SPDX-License-Identifier: Apache-2.0
"""A real SocketCAN: vcan, and the kernel's slcan over a pseudo-terminal.

Not covered: bit timing and a bus-off that is not merely reported, which need a wire.
"""

from __future__ import annotations

import itertools
import os
import pty
import select
import shutil
import socket
import subprocess
import threading
import time
import tty
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from comcal.errors import HardwareError
from comcal_drivers.bus.error_frames import BUS_OFF, error_frame, is_gap
from comcal_drivers.bus.open import open_bus
from comcal_drivers.bus.reader import BusReader
from comcal_drivers.bus.socketcan import BulkSocketcanBus
from comcal_drivers.devices.configuration import BusConfig
from comcal_drivers.frames.batch import SENT, FrameBatch
from comcal_drivers.frames.batches import concatenate, take
from comcal_drivers.frames.frame_log import FrameLog
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import pack, to_messages

COLUMNS = ("t", "ids", "lengths", "data", "kinds")
LONGEST_WAIT = 10.0
BURST = 2000
_numbers = itertools.count(1)


def until(is_true: Callable[[], object]) -> None:
    deadline = time.monotonic() + LONGEST_WAIT
    while not is_true():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True, timeout=10)


@pytest.fixture
def interface() -> Iterator[str]:
    """A virtual CAN interface of this test alone."""
    name = f"vcan{next(_numbers)}"
    ip("add", "dev", name, "type", "vcan")
    ip("set", name, "mtu", "72", "up")
    yield name
    subprocess.run(["ip", "link", "delete", name], check=False, timeout=10, capture_output=True)


@pytest.fixture
def config(interface: str) -> BusConfig:
    return BusConfig("can0", "socketcan", interface)


@pytest.fixture
def far_end(interface: str) -> Iterator[can.BusABC]:
    """Another program on the same bus, as python-can makes it."""
    with can.Bus(interface="socketcan", channel=interface, fd=True) as bus:
        yield bus


def message(k: int, **others: object) -> can.Message:
    usual = {
        "arbitration_id": 0x100 + k % 7,
        "is_extended_id": False,
        "data": k.to_bytes(8, "little"),
    }
    return can.Message(**{**usual, **others})


def numbers(batch: FrameBatch) -> list[int]:
    return np.ascontiguousarray(batch.data).view("<u8")[:, 0].tolist()


def collect(reader: BusReader, wanted: int) -> FrameBatch:
    parts: list[FrameBatch] = []
    until(lambda: parts.append(reader.take(0.1)) or sum(map(len, parts)) >= wanted)
    return concatenate(parts)


def drain(bus: BulkSocketcanBus) -> FrameBatch:
    parts = [bus.receive(0.2)]
    while len(parts[-1]):
        parts.append(bus.receive(0.0))
    return concatenate(parts)


def test_frames_come_complete_in_order_and_as_logged(config, far_end, tmp_path):
    with FrameLog(tmp_path / "frames.log") as log, BusReader(config, log) as reader:
        for k in range(3000):
            far_end.send(message(k), 1.0)
        live = collect(reader, 3000)
        health = reader.health()
    assert numbers(live) == list(range(3000))
    assert (health.frames, health.lost, health.exception) == (3000, 0, "")
    assert (np.diff(live.t) >= 0).all()
    logged = concatenate(read_log(log.path))
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(logged, column), getattr(live, column))


def test_every_kind_of_frame_is_read_as_python_can_reads_it(interface, far_end):
    kinds = [
        message(1),
        message(2, arbitration_id=0x1ABCDEF0, is_extended_id=True),
        message(3, is_remote_frame=True, data=None, dlc=5),
        message(4, data=b""),
        message(5, is_fd=True, data=bytes(range(48))),
        message(6, is_error_frame=True),
    ]
    ours = BulkSocketcanBus(interface, fd=True)
    with can.Bus(interface="socketcan", channel=interface, fd=True) as theirs:
        for one in kinds:
            far_end.send(one, 1.0)
        read = drain(ours)
        expected = pack([theirs.recv(1.0) for _ in kinds])
    ours.shutdown()
    for column in COLUMNS[:-1]:
        np.testing.assert_array_equal(getattr(read, column), getattr(expected, column))
    # python-can says "sent" of what any program on this computer sent; here it is this program's.
    np.testing.assert_array_equal(read.kinds, expected.kinds & ~SENT)


def test_a_burst_that_the_usual_buffer_loses_is_kept(interface, far_end):
    ours = open_bus(BusConfig("can0", "socketcan", interface))
    with can.Bus(interface="socketcan", channel=interface) as usual:
        for k in range(BURST):
            far_end.send(message(k), 1.0)
        kept_usually = sum(1 for _ in iter(lambda: usual.recv(0), None))
    assert kept_usually < BURST / 2, "the burst is too short to show anything"
    assert numbers(drain(ours)) == list(range(BURST))
    assert ours.lost == 0
    ours.shutdown()


def test_what_the_kernel_drops_is_counted_and_marked_where_it_was(interface, far_end):
    ours = BulkSocketcanBus(interface, receive_buffer=50_000)
    for k in range(BURST):
        far_end.send(message(k), 1.0)
    first = drain(ours)
    # The kernel tells of a loss with the first frame that it keeps afterwards.
    far_end.send(message(BURST), 1.0)
    stream = concatenate([first, drain(ours)])
    got = numbers(take(stream, ~is_gap(stream)))
    assert 0 < len(got) < BURST
    assert ours.lost == BURST + 1 - len(got)
    (mark,) = np.flatnonzero(is_gap(stream))
    assert got[:mark] == list(range(mark))
    assert got[mark:] == [BURST]
    ours.shutdown()


def test_losses_of_the_kernel_are_in_the_health_of_the_reader(config, far_end):
    def opener(of: BusConfig) -> can.BusABC:
        bus = BulkSocketcanBus(str(of.channel), receive_buffer=20_000)
        for k in range(BURST):
            far_end.send(message(k), 1.0)
        return bus

    with BusReader(config, opener=opener) as reader:
        until(lambda: reader.health().frames)
        far_end.send(message(0), 1.0)
        until(lambda: reader.health().lost_by_kernel)
        health = reader.health()
        assert health.frames + health.lost_by_kernel == BURST + 1
        assert is_gap(collect(reader, health.frames)).any()


def test_messages_that_are_sent_arrive_and_are_recorded_once(config, far_end):
    with BusReader(config) as reader:
        reader.send(message(7))
        assert far_end.recv(2.0).data[0] == 7
        far_end.send(message(8), 1.0)
        stream = collect(reader, 2)
        assert len(reader.take(0.1)) == 0
    assert numbers(stream) == [7, 8]
    assert (stream.kinds & SENT != 0).tolist() == [True, False]


def test_an_error_frame_of_bus_off_is_seen_although_python_can_says_active(config, far_end):
    with BusReader(config) as reader:
        for one in to_messages(error_frame(0.0, BUS_OFF)):
            far_end.send(one, 1.0)
        until(lambda: reader.health().bus_off)
        far_end.send(message(1), 1.0)
        until(lambda: not reader.health().bus_off)


def test_an_interface_that_goes_down_or_away_and_comes_back_is_read_on(config, interface):
    with BusReader(config) as reader:
        for take_away, bring_back in (
            ([("set", interface, "down")], [("set", interface, "up")]),
            (
                [("delete", interface)],
                [("add", "dev", interface, "type", "vcan"), ("set", interface, "up")],
            ),
        ):
            before = reader.health().reconnects
            for words in take_away:
                ip(*words)
            until(lambda: not reader.health().is_connected)
            assert reader.health().exception
            for words in bring_back:
                ip(*words)
            until(lambda before=before: reader.health().reconnects > before)
            with can.Bus(interface="socketcan", channel=interface) as far_end:
                far_end.send(message(9), 1.0)
                stream = collect(reader, 2)
            assert is_gap(stream).tolist() == [True, False]


def test_an_interface_that_is_down_names_the_command_that_brings_it_up(config, interface):
    ip("set", interface, "down")
    with pytest.raises(HardwareError, match=rf"is down; type: sudo ip link set {interface} up"):
        open_bus(config)


def test_an_interface_that_is_not_there_names_those_that_are(interface):
    with pytest.raises(HardwareError, match=f"interfaces here are: .*{interface}.*ip link set"):
        open_bus(BusConfig("can0", "socketcan", "can9"))


class Adapter:
    """What hangs on the other end of the serial line: answers, and sends when it is told to."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.path, self.heard = os.ttyname(slave), b""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(LONGEST_WAIT)
        os.close(self.master)

    def _listen(self) -> None:
        while not self._stop.is_set():
            if select.select([self.master], [], [], 0.05)[0]:
                piece = os.read(self.master, 256)
                self.heard += piece
                os.write(self.master, b"\r" * piece.count(b"\r"))


@pytest.mark.skipif(shutil.which("slcand") is None, reason="no slcand here; see can-utils")
def test_the_slcan_driver_of_the_kernel_brings_every_frame_both_ways():
    adapter = Adapter()
    driver = subprocess.Popen(["slcand", "-F", "-o", "-c", "-s8", adapter.path, "slcan7"])
    try:
        until(lambda: "slcan7" in {name for _, name in socket.if_nameindex()})
        ip("set", "slcan7", "up")
        with BusReader(BusConfig("can0", "socketcan", "slcan7")) as reader:
            for k in range(500):
                text = f"t1238{k.to_bytes(8, 'little').hex().upper()}\r"
                os.write(adapter.master, text.encode())
                time.sleep(0.001)
            stream = collect(reader, 500)
            reader.send(can.Message(arbitration_id=0x20, is_extended_id=False, data=b"\xab"))
            until(lambda: b"t0201AB\r" in adapter.heard)
        assert numbers(stream) == list(range(500))
        assert b"S8\r" in adapter.heard
        assert b"O\r" in adapter.heard
    finally:
        driver.terminate()
        driver.wait(LONGEST_WAIT)
        adapter.close()
