# SPDX-License-Identifier: Apache-2.0
"""SocketCAN, read in bulk with a large receive buffer, and with the kernel's count of losses.

The kernel's default buffer holds some 300 frames, a twentieth of a second at full load, and drops
the rest without a word. A larger one is asked for, and the socket option ``SO_RXQ_OVFL`` says with
each frame how many were dropped before it. Error frames of every class are asked for by
python-can, which makes the socket.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct

import can
import numpy as np
import numpy.typing as npt
from can.interfaces.socketcan import SocketcanBus

from comcal_drivers.bus.batch_bus import BatchBus
from comcal_drivers.bus.error_frames import gap_marker
from comcal_drivers.frames.batch import ERROR, EXTENDED, FD, REMOTE, SENT, FrameBatch
from comcal_drivers.frames.batches import CLASSIC, LONG, concatenate, take, to_microseconds

RECEIVE_BUFFER = 1 << 23
"""Asked of the kernel, which grants twice as much and counts 770 bytes a frame: room for two
seconds of a full bus of 1 Mbit/s [bytes]."""

MOST = 4096
"""Frames that are taken from the socket at once."""

FRAME_SIZE, FD_FRAME_SIZE = 16, 72
_HEAD = np.dtype([("id", "=u4"), ("length", "u1"), ("flags", "u1"), ("reserved", "u2")])
_ERROR_FLAG, _REMOTE_FLAG = np.uint32(1 << 29), np.uint32(1 << 30)
_IDENTIFIER = np.uint32(0x1FFFFFFF)

# Linux socket options that Python's socket module does not name.
_SO_RXQ_OVFL, _SO_RCVBUFFORCE, _SO_TIMESTAMPNS = 40, 33, 35
_TIMESPEC, _COUNT = struct.Struct("@ll"), struct.Struct("@I")
_ANCILLARY_SIZE = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_COUNT.size)
_IS_OWN = socket.MSG_CONFIRM


class BulkSocketcanBus(BatchBus):
    """A SocketCAN interface.

    Parameters
    ----------
    channel : str
        Network interface, such as ``can0``.
    fd : bool
        Whether CAN FD frames are wanted, too.
    receive_buffer : int
        Asked of the kernel [bytes].

    Raises
    ------
    OSError
        No such interface, it is down, or the kernel has no SocketCAN.
    """

    def __init__(
        self, channel: str, *, fd: bool = False, receive_buffer: int = RECEIVE_BUFFER
    ) -> None:
        require(channel)
        self._bus = SocketcanBus(channel, fd=fd)
        self._socket = self._bus.socket
        self._dropped = 0
        self.lost = 0
        """Frames that the kernel dropped because its buffer was full."""
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            self.receive_buffer = enlarge(self._socket, receive_buffer)
            """What the kernel granted [bytes]."""
            # An interface that is down can be bound; the socket only holds the error ready.
            pending = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if pending:
                raise OSError(pending, os.strerror(pending), channel)
        except BaseException:
            self._bus.shutdown()
            raise
        super().__init__(channel)

    def receive(self, timeout: float) -> FrameBatch:
        """Return the frames that are there; see :meth:`BatchBus.receive`."""
        try:
            ready = select.select([self._socket], [], [], timeout)[0]
            rows = self._read_all() if ready else []
        except OSError as error:
            raise can.CanOperationError(f"failed to receive: {error}", error.errno) from error
        return self._batch(rows)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message; see :meth:`can.BusABC.send`."""
        self._bus.send(msg, timeout)

    def fileno(self) -> int:
        """Return the file descriptor of the socket."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Close the socket."""
        super().shutdown()
        self._bus.shutdown()

    def _read_all(self) -> list[tuple[bytes, float, bool, int]]:
        """Return frame, stamp, whether it is our own, and the frames lost just before it."""
        rows: list[tuple[bytes, float, bool, int]] = []
        while len(rows) < MOST:
            try:
                frame, ancillary, flags, _ = self._socket.recvmsg(
                    FD_FRAME_SIZE, _ANCILLARY_SIZE, socket.MSG_DONTWAIT
                )
            except BlockingIOError:
                break
            stamp, dropped = np.nan, self._dropped
            for _level, kind, content in ancillary:
                if kind == _SO_TIMESTAMPNS:
                    seconds, nanoseconds = _TIMESPEC.unpack_from(content)
                    stamp = seconds + nanoseconds * 1e-9
                elif kind == _SO_RXQ_OVFL:
                    dropped = _COUNT.unpack_from(content)[0]
            # The kernel's count has 32 bits.
            rows.append(
                (frame, stamp, bool(flags & _IS_OWN), (dropped - self._dropped) % (1 << 32))
            )
            self._dropped = dropped
        return rows

    def _batch(self, rows: list[tuple[bytes, float, bool, int]]) -> FrameBatch:
        if not rows:
            return concatenate(())
        frames, stamps, own, lost = zip(*rows, strict=True)
        batch = unpack(frames, np.array(stamps), np.array(own))
        gaps = np.flatnonzero(lost)
        if gaps.size == 0:
            return batch
        self.lost += sum(lost)
        parts: list[FrameBatch] = []
        for start, end in zip([0, *gaps], [*gaps, len(rows)], strict=True):
            if start < end:
                parts.append(take(batch, slice(start, end)))
            if end < len(rows):
                parts.append(gap_marker(float(batch.t[end])))
        return concatenate(parts)


def require(channel: str) -> None:
    """See that there is such an interface; python-can leaves its socket open when there is none.

    Parameters
    ----------
    channel : str

    Raises
    ------
    OSError
        The kernel has no SocketCAN, or no such interface.
    """
    socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    if channel not in {name for _, name in socket.if_nameindex()}:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV), channel)


def enlarge(can_socket: socket.socket, size: int) -> int:
    """Ask the kernel for a larger receive buffer.

    Parameters
    ----------
    can_socket : socket.socket
    size : int
        Wanted [bytes]. Only the administrator gets more than ``net.core.rmem_max``.

    Returns
    -------
    int
        Granted [bytes]: Linux doubles what it is asked for, for its own book-keeping.
    """
    try:
        can_socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, size)
    except PermissionError:
        can_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
    return can_socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def unpack(
    frames: tuple[bytes, ...], stamps: npt.NDArray[np.float64], own: npt.NDArray[np.bool_]
) -> FrameBatch:
    """Return the kernel's frames (``struct can_frame``, ``canfd_frame``) as columns.

    Parameters
    ----------
    frames : tuple of bytes
        16 bytes each, or 72 with CAN FD.
    stamps : array, shape (n,)
        [s]
    own : array of bool, shape (n,)
        Whether this socket sent it.

    Returns
    -------
    FrameBatch
    """
    sizes = np.array([len(frame) for frame in frames])
    is_fd = sizes == FD_FRAME_SIZE
    size, width = (FD_FRAME_SIZE, LONG) if is_fd.any() else (FRAME_SIZE, CLASSIC)
    content = b"".join([frame.ljust(size, b"\0") for frame in frames])
    raw = np.frombuffer(content, np.uint8).reshape(len(frames), size)
    head = np.ascontiguousarray(raw[:, : _HEAD.itemsize]).view(_HEAD).ravel()
    data = raw[:, _HEAD.itemsize :].copy()
    lengths = head["length"]
    data[np.arange(width) >= lengths[:, None]] = 0
    is_error = (head["id"] & _ERROR_FLAG) != 0
    is_remote = (head["id"] & _REMOTE_FLAG) != 0
    is_extended = ((head["id"] & EXTENDED) != 0) & ~is_error
    return FrameBatch(
        t=to_microseconds(stamps),
        ids=(head["id"] & _IDENTIFIER) | (is_extended * EXTENDED),
        lengths=np.ascontiguousarray(lengths),
        data=data,
        kinds=is_error * ERROR + is_remote * REMOTE + is_fd * FD + own * SENT,
    )
