# SPDX-License-Identifier: Apache-2.0
"""A network interface of Linux: the robot as another node on a real or virtual SocketCAN bus.

A virtual bus (``vcan``) has no wire, so nothing slows a sender down and a slow reader loses frames
without a word. Here every frame takes the time that it would take on a wire of the bus's bit rate.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import struct
import time
from collections import deque
from collections.abc import Mapping, Sequence

from comcal.errors import HardwareError
from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame

_FRAME = struct.Struct("=IB3x8s")
_ERROR_FLAG, _REMOTE_FLAG = 1 << 29, 1 << 30
_LATER = (errno.EAGAIN, errno.ENOBUFS)
_PAUSE = 0.001
"""Until the queue of the interface, which tells nobody when it is full, is tried again [s]."""

HEAD, HEAD_EXTENDED = 47, 67
"""Bits of a frame without data, with the pause after it [bit]."""
STUFFING = 1.2
"""The wire carries up to a fifth more than the frame's own bits."""
AHEAD = 0.02
"""How much of the wire's time may be used in advance, for clocks that tick slowly [s]."""


class SocketcanAdapter:
    """A node on a bus that is up already.

    Parameters
    ----------
    interface : str
        Network interface, such as ``vcan0``.
    bitrate : int
        Of the wire [bit/s].

    Raises
    ------
    HardwareError
        If there is no such interface, or it is down.
    """

    def __init__(self, interface: str, bitrate: int = 1_000_000) -> None:
        self._interface = interface
        self._bitrate = bitrate
        self._socket: socket.socket | None = None
        self._queue = deque[Frame]()
        self._is_heard = False
        self._free_at = 0.0
        try:
            self.connect()
        except OSError as error:
            raise HardwareError(
                f"the interface {interface} cannot be opened: {os.strerror(error.errno or 0)}",
                where="--adapter socketcan",
                next_step="for a virtual one type: sudo modprobe vcan && sudo ip link add "
                f"{interface} type vcan && sudo ip link set {interface} up",
            ) from error

    @property
    def connection(self) -> Mapping[str, object]:
        """Interface and its name."""
        return {"interface": "socketcan", "channel": self._interface}

    @property
    def is_open(self) -> bool:
        """Whether any other node was heard: a bus does not tell who listens."""
        return self._is_heard

    @property
    def backlog(self) -> int:
        """Frames that the wire has not carried yet."""
        return len(self._queue)

    @property
    def fds(self) -> tuple[list[int], list[int]]:
        """The socket; none while the wire is busy, which has no file that says when it is free."""
        if self._socket is None or (self._queue and not self._is_free):
            return [], []
        number = self._socket.fileno()
        return [number], [number] if self._queue else []

    def receive(self) -> list[Frame]:
        """Return what other nodes sent."""
        frames = list[Frame]()
        while self._socket is not None:
            try:
                number, length, data = _FRAME.unpack(self._socket.recv(_FRAME.size))
            except OSError:  # nothing there, or the interface is down
                break
            self._is_heard = True
            kind = REMOTE if number & _REMOTE_FLAG else 0
            frames.append(Frame(number & ~_REMOTE_FLAG, data[:length], kind=kind))
        return frames

    def send(self, frames: Sequence[Frame]) -> None:
        """Queue frames for the wire."""
        if self._socket is not None:
            self._queue.extend(frames)

    def flush(self) -> None:
        """Pass on what the wire has carried by now."""
        now = time.monotonic()
        if abs(self._free_at - now) > AHEAD:  # idle for long, or the clock of a guest went back
            self._free_at = now - AHEAD
        while self._socket is not None and self._queue and self._is_free:
            frame = self._queue[0]
            try:
                self._socket.send(_packed(frame))
            except OSError as error:
                if error.errno in _LATER:
                    self._free_at = time.monotonic() + _PAUSE
                else:
                    self._queue.clear()  # the interface is down: what was on its way is lost
                return
            self._queue.popleft()
            self._free_at += self._duration(frame)

    def disconnect(self) -> None:
        """Leave the bus; the interface stays."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        self._queue.clear()

    def connect(self) -> None:
        """Join the bus again."""
        if self._socket is not None:
            return
        node = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            node.setblocking(False)
            node.bind((self._interface,))
            # An interface that is down can be bound; the socket only holds the error ready.
            pending = node.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if pending:
                raise OSError(pending, os.strerror(pending))
        except BaseException:
            node.close()
            raise
        self._socket = node

    def note_bus_off(self) -> None:
        """Nothing: the error frame itself tells."""

    def close(self) -> None:
        """Leave the bus."""
        with contextlib.suppress(OSError):
            self.disconnect()

    @property
    def _is_free(self) -> bool:
        """Whether the wire has carried what was sent before, or the clock went back."""
        return not 0.0 < self._free_at - time.monotonic() <= AHEAD

    def _duration(self, frame: Frame) -> float:
        """Return how long the wire is busy with a frame [s]."""
        head = HEAD_EXTENDED if frame.id & EXTENDED else HEAD
        data = 0 if frame.kind == REMOTE else 8 * len(frame.data)
        return STUFFING * (head + data) / self._bitrate


def _packed(frame: Frame) -> bytes:
    """Return a frame as ``struct can_frame``."""
    flag = {REMOTE: _REMOTE_FLAG, ERROR: _ERROR_FLAG}.get(frame.kind, 0)
    data = b"" if frame.kind == REMOTE else frame.data
    return _FRAME.pack(frame.id | flag, len(frame.data), data)
