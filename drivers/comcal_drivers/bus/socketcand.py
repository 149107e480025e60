# SPDX-License-Identifier: Apache-2.0
"""A CAN bus of another computer that runs socketcand, over TCP.

python-can has one as well; it takes the end of the connection for silence, and tries to connect
for ten seconds without a pause.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time

import can

from comcal_drivers.bus.batch_bus import BatchBus
from comcal_drivers.bus.socketcand_lines import SocketcandLines, socketcand_line
from comcal_drivers.frames.batch import FrameBatch

READ_SIZE = 1 << 16
CONNECT_TIME = 3.0
"""How long the daemon may take to answer [s]."""


class SocketcandBus(BatchBus):
    """Client of socketcand in raw mode.

    Parameters
    ----------
    channel : str
        The daemon's name of the bus, such as ``can0``.
    host : str
    port : int
        Address of the daemon.

    Raises
    ------
    OSError
        Nobody answers at that address.
    can.CanInitializationError
        Who answers is no socketcand, or has no such bus.
    """

    def __init__(self, channel: str, host: str = "localhost", port: int = 29536) -> None:
        self._lines = SocketcandLines()
        self._rest = b""
        self._socket = socket.create_connection((host, port), CONNECT_TIME)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._expect(b"hi")
            for command, purpose in ((f"open {channel}", "open"), ("rawmode", "raw mode")):
                self._socket.sendall(f"< {command} >".encode("ascii"))
                self._expect(b"ok", purpose)
        except BaseException:
            self._socket.close()
            raise
        super().__init__(channel)

    @property
    def garbage(self) -> int:
        """Messages of the daemon that were no frames."""
        return self._lines.garbage

    def receive(self, timeout: float) -> FrameBatch:
        """Return the frames that are there; see :meth:`BatchBus.receive`."""
        received, self._rest = self._rest, b""
        return self._lines.feed(received or self._read(timeout))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message.

        Parameters
        ----------
        msg : can.Message
        timeout : float, optional
            Ignored: sending takes at most :data:`CONNECT_TIME`.

        Raises
        ------
        can.CanOperationError
            The daemon is gone.
        """
        try:
            self._socket.sendall(socketcand_line(msg))
        except OSError as error:
            raise can.CanOperationError(f"socketcand is gone: {error}") from error

    def fileno(self) -> int:
        """Return the file descriptor of the connection."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Close the connection."""
        if self._is_shutdown:
            return
        super().shutdown()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _read(self, timeout: float) -> bytes:
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return b""
            received = self._socket.recv(READ_SIZE)
        except OSError as error:
            raise can.CanOperationError(f"socketcand is gone: {error}") from error
        if not received:
            raise can.CanOperationError("socketcand has closed the connection")
        return received

    def _expect(self, answer: bytes, purpose: str = "greet") -> None:
        deadline = time.monotonic() + CONNECT_TIME
        while b">" not in self._rest:
            left = deadline - time.monotonic()
            if left <= 0:
                raise can.CanInitializationError(f"socketcand does not answer ({purpose})")
            self._rest += self._read(left)
        said, _, self._rest = self._rest.partition(b">")
        if said.strip(b"< \r\n") != answer:
            raise can.CanInitializationError(
                f"expected '< {answer.decode()} >' ({purpose}),"
                f" got '{said.decode('ascii', 'replace').strip()} >'"
            )
