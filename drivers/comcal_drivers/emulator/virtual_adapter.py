# SPDX-License-Identifier: Apache-2.0
"""The virtual bus of python-can, for hosts in the same process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import can
from can.interfaces.virtual import VirtualBus

from comcal_drivers.emulator.frame import ERROR, EXTENDED, REMOTE, Frame

_PATIENCE = 1.0
"""How long one frame may wait for a full queue [s]."""


class VirtualAdapter:
    """A node on a virtual bus; it cannot be unplugged, only fall silent.

    Parameters
    ----------
    channel : str
        Name of the bus, unique within the process.
    """

    def __init__(self, channel: str) -> None:
        self.lost = 0
        self._channel = channel
        self._bus = VirtualBus(channel, preserve_timestamps=True)
        self._is_connected = True

    @property
    def connection(self) -> Mapping[str, object]:
        """Interface and channel."""
        return {"interface": "virtual", "channel": self._channel}

    @property
    def is_open(self) -> bool:
        """Whether there is any other node."""
        return self._is_connected and len(self._bus.channel) > 1

    @property
    def backlog(self) -> int:
        """Messages that the slowest other node has not taken yet."""
        others = (queue for queue in tuple(self._bus.channel) if queue is not self._bus.queue)
        return max((queue.qsize() for queue in others), default=0)

    @property
    def fds(self) -> tuple[list[int], list[int]]:
        """None: a virtual bus has no files."""
        return [], []

    def receive(self) -> list[Frame]:
        """Return what other nodes sent."""
        frames = list[Frame]()
        while (message := self._bus.recv(0)) is not None:
            if message.is_error_frame or not self._is_connected:
                continue
            flag = EXTENDED if message.is_extended_id else 0
            data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
            kind = REMOTE if message.is_remote_frame else 0
            frames.append(Frame(message.arbitration_id | flag, data, message.timestamp, kind))
        return frames

    def send(self, frames: Sequence[Frame]) -> None:
        """Give frames to all other nodes; lost where one with a bounded queue does not read."""
        if not self._is_connected:
            return
        for frame in frames:
            try:
                self._bus.send(_message(frame), timeout=_PATIENCE)
            except can.CanOperationError:
                self.lost += 1

    def flush(self) -> None:
        """Nothing is ever queued here."""

    def disconnect(self) -> None:
        """Fall silent and deaf."""
        self._is_connected = False

    def connect(self) -> None:
        """Speak and hear again."""
        self._is_connected = True

    def note_bus_off(self) -> None:
        """Nothing: the error frame itself tells."""

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


def _message(frame: Frame) -> can.Message:
    is_remote = frame.kind == REMOTE
    return can.Message(
        timestamp=frame.t,
        arbitration_id=frame.id & ~EXTENDED,
        is_extended_id=bool(frame.id & EXTENDED),
        is_remote_frame=is_remote,
        is_error_frame=frame.kind == ERROR,
        dlc=len(frame.data),
        data=None if is_remote else frame.data,
    )
