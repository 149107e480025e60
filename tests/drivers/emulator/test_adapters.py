# SPDX-License-Identifier: Apache-2.0
"""Adapters against python-can's own clients."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast

import can
import pytest

from comcal_drivers.emulator.adapter import Adapter
from comcal_drivers.emulator.frame import ERROR, EXTENDED, Frame
from comcal_drivers.emulator.slcan_adapter import SlcanAdapter
from comcal_drivers.emulator.socketcand_adapter import SocketcandAdapter
from comcal_drivers.emulator.virtual_adapter import VirtualAdapter

FRAMES = [
    Frame(0x20A, bytes(range(8))),
    Frame(0x7F0),
    Frame(0x901 | EXTENDED, b"\xff\x00"),
    *(Frame(0x100 + k % 256, bytes([k % 256] * (k % 9))) for k in range(500)),
]
MAKERS: dict[str, Callable[[], Adapter]] = {
    "slcan": lambda: SlcanAdapter("can0"),
    "socketcand": lambda: SocketcandAdapter("can0"),
    "virtual": lambda: VirtualAdapter("test of adapters"),
}
WAIT = 5.0


@contextmanager
def running(adapter: Adapter) -> Iterator[list[Frame]]:
    """Serve an adapter from a thread; yields what hosts send."""
    heard, over = list[Frame](), threading.Event()

    def serve() -> None:
        while not over.wait(0.001):
            heard.extend(adapter.receive())
            adapter.flush()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield heard
    finally:
        over.set()
        thread.join(WAIT)
        adapter.close()


def client(adapter: Adapter) -> can.BusABC:
    options = dict(adapter.connection)
    if options["interface"] == "slcan":
        options["sleep_after_open"] = 0.0
    return can.Bus(**cast("dict[str, str]", options))


def until(is_so: Callable[[], bool]) -> None:
    end = time.monotonic() + WAIT
    while not is_so():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.002)


@pytest.mark.parametrize("name", MAKERS)
def test_both_directions_keep_every_frame_in_order(name: str) -> None:
    adapter = MAKERS[name]()
    with running(adapter) as heard, client(adapter) as bus:
        until(lambda: adapter.is_open)
        adapter.send(FRAMES)
        got = [bus.recv(WAIT) for _ in FRAMES]
        assert all(got)
        assert [
            (m.arbitration_id | (EXTENDED if m.is_extended_id else 0), bytes(m.data))
            for m in got
            if m is not None
        ] == [(f.id, f.data) for f in FRAMES]
        for frame in FRAMES[:50]:
            bus.send(
                can.Message(
                    arbitration_id=frame.bare_id,
                    is_extended_id=frame.id >= EXTENDED,
                    data=frame.data,
                )
            )
        until(lambda: len(heard) >= 50)
        assert [(f.id, f.data) for f in heard] == [(f.id, f.data) for f in FRAMES[:50]]


@pytest.mark.parametrize("name", ["socketcand", "virtual"])
def test_stamps_and_error_frames_arrive_where_the_interface_has_them(name: str) -> None:
    adapter = MAKERS[name]()
    with running(adapter), client(adapter) as bus:
        until(lambda: adapter.is_open)
        adapter.send([Frame(0x123, b"\x01", 61.25), Frame(0x40, bytes(8), 61.5, ERROR)])
        first, second = bus.recv(WAIT), bus.recv(WAIT)
        assert first is not None
        assert first.timestamp == 61.25
        assert second is not None
        assert second.is_error_frame


def test_nothing_is_sent_to_a_host_that_does_not_listen() -> None:
    for make in MAKERS.values():
        adapter = make()
        try:
            adapter.send(FRAMES)
            adapter.flush()
            assert not adapter.is_open
            assert adapter.backlog == 0
        finally:
            adapter.close()


@contextmanager
def host(adapter: Adapter) -> Iterator[Callable[[], bytes]]:
    """Listen without python-can; yields what reads."""
    connection = adapter.connection
    if connection["interface"] == "slcan":
        with Path(str(connection["channel"])).open("r+b", buffering=0) as port:
            port.write(b"O\r")
            yield lambda: port.read(100)
    else:
        address = (str(connection["host"]), int(str(connection["port"])))
        with socket.create_connection(address) as stream:
            stream.sendall(b"< open can0 >< rawmode >")
            yield lambda: stream.recv(100)


def ends(read: Callable[[], bytes]) -> bool:
    """Whether a stream ends, with an error or without, after what is still in it."""
    try:
        while read():
            pass
    except OSError:
        pass
    return True


@pytest.mark.parametrize("name", ["slcan", "socketcand"])
def test_an_unplugged_adapter_comes_back_under_its_name(name: str) -> None:
    adapter = MAKERS[name]()
    before = dict(adapter.connection)
    with running(adapter):
        with host(adapter) as read:
            until(lambda: adapter.is_open)
            adapter.disconnect()
            assert ends(read)
        adapter.connect()
        assert dict(adapter.connection) == before
        with client(adapter) as again:
            until(lambda: adapter.is_open)
            adapter.send(FRAMES[:3])
            got = [again.recv(WAIT) for _ in range(3)]
            assert [m.arbitration_id for m in got if m] == [f.bare_id for f in FRAMES[:3]]


def test_a_full_fifo_loses_frames_and_says_so() -> None:
    adapter = SlcanAdapter("can0", fifo=10)
    try:
        with Path(str(adapter.connection["channel"])).open("r+b", buffering=0) as port:
            port.write(b"O\r")
            port.flush()
            until(lambda: (adapter.receive(), adapter.is_open)[1])
            adapter.flush()
            adapter.send(FRAMES[:25])
            assert adapter.lost == 15
            port.write(b"F\r")
            port.flush()
            until(lambda: (adapter.receive(), adapter.backlog > 10)[1])
            adapter.flush()
            text = b""
            while text.count(b"\r") < 12:
                text += port.read(2000)
            lines = text.split(b"\r")
            assert lines[-2] == b"F09"
            assert len(lines) == 1 + 10 + 1 + 1
    finally:
        adapter.close()


def test_a_closed_adapter_leaves_no_port_behind() -> None:
    adapter = SlcanAdapter("can0")
    port = Path(str(adapter.connection["channel"]))
    assert port.exists()
    adapter.close()
    assert not port.is_symlink()
    assert not port.parent.exists()
