# SPDX-License-Identifier: Apache-2.0
"""The emulator as a node on a bus of the kernel, against python-can."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator

import can
import pytest

from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame
from comcal_drivers.emulator.socketcan_adapter import AHEAD, SocketcanAdapter

NAME = "vcan90"
LONGEST_WAIT = 10.0


@pytest.fixture
def interface() -> Iterator[str]:
    words = ["ip", "link"]
    subprocess.run([*words, "add", "dev", NAME, "type", "vcan"], check=True, timeout=10)
    subprocess.run([*words, "set", NAME, "up"], check=True, timeout=10)
    yield NAME
    subprocess.run([*words, "delete", NAME], check=False, timeout=10)


@pytest.fixture
def adapter(interface: str) -> Iterator[SocketcanAdapter]:
    made = SocketcanAdapter(interface)
    yield made
    made.close()


@pytest.fixture
def host(interface: str) -> Iterator[can.BusABC]:
    with can.Bus(interface="socketcan", channel=interface) as bus:
        yield bus


def until(is_true: Callable[[], object]) -> None:
    deadline = time.monotonic() + LONGEST_WAIT
    while not is_true():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def carried(adapter: SocketcanAdapter) -> None:
    """Let the wire carry everything."""
    until(lambda: adapter.flush() or not adapter.backlog)


FRAMES = [
    Frame(0x20A, bytes(range(8))),
    Frame(0x7F0),
    Frame(0x901 | EXTENDED, b"\xff\x00"),
    Frame(0x123, bytes(3), kind=REMOTE),
    Frame(0x040, bytes(8), kind=ERROR),
]


def test_every_kind_of_frame_arrives_in_order(adapter, host) -> None:
    adapter.send(FRAMES)
    carried(adapter)
    got = [host.recv(1.0) for _ in FRAMES]
    for message, frame in zip(got, FRAMES, strict=True):
        assert message is not None
        assert message.arbitration_id == frame.bare_id
        assert message.is_extended_id == bool(frame.id & EXTENDED) or frame.kind == ERROR
        assert (message.is_remote_frame, message.is_error_frame) == (
            frame.kind == REMOTE,
            frame.kind == ERROR,
        )
        assert message.dlc == len(frame.data)
        assert message.is_remote_frame or bytes(message.data) == frame.data


def test_what_a_host_sends_is_heard_and_opens_the_bus(adapter, host) -> None:
    assert not adapter.is_open
    host.send(can.Message(arbitration_id=0x7F1, data=b"\x01\x00\x01", is_extended_id=False))
    host.send(can.Message(arbitration_id=0x1ABCDEF0, is_remote_frame=True, dlc=2))
    heard: list[Frame] = []
    until(lambda: heard.extend(adapter.receive()) or len(heard) == 2)
    assert heard == [
        Frame(0x7F1, b"\x01\x00\x01"),
        Frame(0x1ABCDEF0 | EXTENDED, bytes(2), kind=REMOTE),
    ]
    assert adapter.is_open


def test_the_wire_takes_its_time(interface) -> None:
    adapter = SocketcanAdapter(interface, bitrate=125_000)
    adapter.send([Frame(0x123, bytes(8))] * 200)
    began = time.monotonic()
    carried(adapter)
    taken = time.monotonic() - began
    adapter.close()
    bits = 200 * 111
    assert taken >= bits / 125_000 - AHEAD
    assert taken < 3 * bits / 125_000


def test_it_leaves_the_bus_and_joins_it_again(adapter, host) -> None:
    adapter.disconnect()
    adapter.send(FRAMES)
    adapter.flush()
    assert adapter.backlog == 0
    assert adapter.receive() == []
    adapter.connect()
    adapter.send(FRAMES[:1])
    carried(adapter)
    message = host.recv(1.0)
    assert message is not None
    assert message.arbitration_id == 0x20A
