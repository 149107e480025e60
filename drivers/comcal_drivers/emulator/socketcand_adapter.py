# SPDX-License-Identifier: Apache-2.0
"""A socketcand server on the loopback interface."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.outbox import Outbox
from comcal_drivers.emulator.socketcand_protocol import (
    GREETING,
    SocketcandSession,
    socketcand_message,
)

HOST = "127.0.0.1"
_READ = 4096
PAUSE = 0.05
"""Between the last answer and the first frame [s]: python-can's client wants the answer alone."""


@dataclass
class _Client:
    connection: socket.socket
    session: SocketcandSession
    outbox: Outbox
    ready_at: float = 0.0

    @property
    def pauses(self) -> bool:
        """Whether it is not heard, and told nothing, for a moment."""
        return time.monotonic() < self.ready_at

    @property
    def listens(self) -> bool:
        """Whether frames are passed on to it."""
        return self.session.is_raw and not self.pauses


class SocketcandAdapter:
    """A server of one bus; as many clients as like to may listen to it.

    Parameters
    ----------
    bus : str
        Its name, in robot.yaml and for the clients.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._clients = list[_Client]()
        self._listener = _bound(0)
        self._port = int(self._listener.getsockname()[1])
        self._is_listening = False
        self.connect()

    @property
    def connection(self) -> Mapping[str, object]:
        """Interface, name, host and port."""
        return {
            "interface": "socketcand",
            "channel": self._bus,
            "host": HOST,
            "port": self._port,
        }

    @property
    def is_open(self) -> bool:
        """Whether any client listens in raw mode."""
        return any(client.listens for client in self._clients)

    @property
    def backlog(self) -> int:
        """Messages that the slowest client did not take yet."""
        return max((len(client.outbox) for client in self._clients), default=0)

    @property
    def fds(self) -> tuple[list[int], list[int]]:
        """The listening socket and all connections."""
        reading = [c.connection.fileno() for c in self._clients if not c.pauses]
        writing = [c.connection.fileno() for c in self._clients if len(c.outbox)]
        if self._is_listening:
            reading.append(self._listener.fileno())
        return reading, writing

    def receive(self) -> list[Frame]:
        """Greet new clients, obey old ones; return the frames that they sent."""
        self._greet()
        frames = list[Frame]()
        for client in tuple(self._clients):
            try:
                frames += self._read(client)
            except OSError:
                self._drop(client)
        return frames

    def send(self, frames: Sequence[Frame]) -> None:
        """Queue frames for every client in raw mode."""
        texts = [socketcand_message(frame) for frame in frames]
        for client in self._clients:
            if client.listens:
                for text in texts:
                    client.outbox.put(text)

    def flush(self) -> None:
        """Write as much as the clients take."""
        for client in tuple(self._clients):
            try:
                client.outbox.flush()
            except OSError:
                self._drop(client)

    def disconnect(self) -> None:
        """Close all connections and refuse new ones."""
        # The door first: whoever is thrown out may be back before it is shut.
        if self._is_listening:
            self._is_listening = False
            self._listener.close()
            # Nobody else may take the port meanwhile; nor may a host that tries in a tight loop get
            # it for its own end, and be connected to itself.
            self._listener = _bound(self._port)
        for client in tuple(self._clients):
            self._drop(client)

    def connect(self) -> None:
        """Listen, on the same port as before."""
        if not self._is_listening:
            self._listener.listen()
            self._is_listening = True

    def note_bus_off(self) -> None:
        """Nothing: the error frame itself tells."""

    def close(self) -> None:
        """Close everything."""
        for client in tuple(self._clients):
            self._drop(client)
        self._is_listening = False
        self._listener.close()

    def _read(self, client: _Client) -> list[Frame]:
        """Return the frames that one client sent.

        Raises
        ------
        OSError
            If it is gone.
        """
        frames = list[Frame]()
        while not client.pauses:
            try:
                received = client.connection.recv(_READ)
            except BlockingIOError:
                break
            if not received:
                raise ConnectionResetError
            was_raw = client.session.is_raw
            answers, sent = client.session.feed(received)
            if client.session.is_raw and not was_raw:
                client.ready_at = time.monotonic() + PAUSE
            client.outbox.put(answers)
            frames += sent
        return frames

    def _greet(self) -> None:
        while self._is_listening:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # nobody there
                return
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = _Client(connection, SocketcandSession((self._bus,)), Outbox(connection.send))
            client.outbox.put(GREETING)
            self._clients.append(client)

    def _drop(self, client: _Client) -> None:
        with contextlib.suppress(OSError):
            client.connection.close()
        self._clients.remove(client)


def _bound(port: int) -> socket.socket:
    """Return a socket that holds a port of the loopback interface, any for 0, and refuses hosts."""
    holder = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    holder.bind((HOST, port))
    holder.setblocking(False)
    return holder
