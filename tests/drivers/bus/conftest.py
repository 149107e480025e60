# SPDX-License-Identifier: Apache-2.0
"""Adapters at the other end of a pseudo-terminal and of a TCP connection, and bounded waiting."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from comcal_drivers.devices.configuration import BusConfig
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate
from comcal_drivers.frames.messages import pack

LONGEST_WAIT = 5.0


@pytest.fixture
def until() -> Callable[[Callable[[], object]], None]:
    """Wait for a condition, five seconds at most."""

    def wait(is_true: Callable[[], object]) -> None:
        deadline = time.monotonic() + LONGEST_WAIT
        while not is_true():
            assert time.monotonic() < deadline, "waited in vain"
            time.sleep(0.005)

    return wait


@pytest.fixture
def collect(until: Callable) -> Callable[[object, int], FrameBatch]:
    """Take frames from a reader until there are so many."""

    def take(reader: object, wanted: int) -> FrameBatch:
        parts: list[FrameBatch] = []

        def is_enough() -> bool:
            parts.append(reader.take(0.05))
            return sum(map(len, parts)) >= wanted

        until(is_enough)
        return concatenate(parts)

    return take


@pytest.fixture(scope="session")
def frames() -> Callable[[int], FrameBatch]:
    """So many frames, each with its number in it."""

    def make(n: int, first: int = 0) -> FrameBatch:
        return pack(
            can.Message(
                timestamp=1.0 + 1e-3 * k,
                arbitration_id=0x100 + k % 7,
                is_extended_id=False,
                data=int(k).to_bytes(8, "little"),
            )
            for k in range(first, first + n)
        )

    return make


@pytest.fixture(scope="session")
def numbers() -> Callable[[FrameBatch], list[int]]:
    """The numbers in such frames."""
    return lambda batch: np.ascontiguousarray(batch.data).view("<u8").ravel().tolist()


def slcan_text(k: int) -> bytes:
    return f"t{0x100 + k % 7:03X}8{int(k).to_bytes(8, 'little').hex()}\r".encode()


class SerialAdapter:
    """A slcan adapter behind a pseudo-terminal that can be pulled out and plugged in again."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.heard = b""
        self.answers: dict[bytes, bytes] = {b"F": b"F00\r"}
        self._master: int | None = None
        self._stop = threading.Event()
        self.plug_in()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def plug_in(self) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))
        self._slave, self._master = slave, master

    def unplug(self) -> None:
        master, self._master = self._master, None
        self.link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(master)

    def say(self, text: bytes) -> None:
        while text:
            text = text[os.write(self._master, text) :]

    def number(self, first: int, last: int) -> None:
        """Send the frames of these numbers."""
        self.say(b"".join(map(slcan_text, range(first, last))))

    def close(self) -> None:
        self._stop.set()
        self._thread.join(LONGEST_WAIT)
        if self._master is not None:
            self.unplug()

    def _listen(self) -> None:
        while not self._stop.is_set():
            master = self._master
            if master is None:
                time.sleep(0.005)
                continue
            with contextlib.suppress(OSError, ValueError, TypeError):
                if select.select([master], [], [], 0.02)[0]:
                    self._answer(os.read(master, 1024))

    def _answer(self, heard: bytes) -> None:
        self.heard += heard
        for command in heard.split(b"\r")[:-1]:
            if command in self.answers or command[:1] in b"CSOL":
                self.say(self.answers.get(command, b"\r"))


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[SerialAdapter]:
    there = SerialAdapter(tmp_path / "ttyADAPTER")
    yield there
    there.close()


@pytest.fixture
def serial_bus(adapter: SerialAdapter) -> BusConfig:
    return BusConfig("can0", "slcan", str(adapter.link), 1_000_000)


class Daemon:
    """A socketcand for one client at a time."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self.heard = b""
        self.greeting = b"< hi >"
        self.client: socket.socket | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def say(self, text: bytes) -> None:
        self.client.sendall(text)

    def hang_up(self) -> None:
        client, self.client = self.client, None
        with contextlib.suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._stop.set()
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        if self.client is not None:
            self.hang_up()
        self._thread.join(LONGEST_WAIT)

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            with client, contextlib.suppress(OSError):
                self._talk(client)

    def _talk(self, client: socket.socket) -> None:
        client.sendall(self.greeting)
        for command in (b"< open can0 >", b"< rawmode >"):
            heard = b""
            while command not in heard:
                piece = client.recv(100)
                if not piece:
                    return
                heard += piece
            client.sendall(b"< ok >")
        self.client = client
        while piece := client.recv(1024):
            self.heard += piece


@pytest.fixture
def daemon() -> Iterator[Daemon]:
    there = Daemon()
    yield there
    there.close()


@pytest.fixture
def daemon_bus(daemon: Daemon) -> BusConfig:
    return BusConfig(
        "can0", "socketcand", "can0", options={"host": "127.0.0.1", "port": daemon.port}
    )
