# SPDX-License-Identifier: Apache-2.0
"""A bus of python-can that also hands over frames by the batch."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque

import can

from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.messages import pack, to_messages

MOST = 4096
"""Messages that are taken at once from a bus that hands them over one by one."""


class BatchBus(can.BusABC):
    """Base of the buses that are read here without a Python object per frame.

    Everything that takes a bus of python-can takes these too; ``recv`` unpacks batches.
    """

    def __init__(self, channel: str) -> None:
        self._unpacked: deque[can.Message] = deque()
        self.channel_info = channel
        super().__init__(channel)

    @abstractmethod
    def receive(self, timeout: float) -> FrameBatch:
        """Return the frames that are there.

        Parameters
        ----------
        timeout : float
            How long to wait for the first one [s].

        Returns
        -------
        FrameBatch
            Empty when nothing came.

        Raises
        ------
        can.CanOperationError
            The device or the connection is gone.
        """

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._unpacked:
            # Waits in pieces: python-can means forever by None, a lost device must not.
            wait = 0.5 if timeout is None else max(timeout, 0.0)
            self._unpacked.extend(to_messages(self.receive(wait), self.channel_info))
        return (self._unpacked.popleft() if self._unpacked else None), False


def receive(bus: can.BusABC, timeout: float) -> FrameBatch:
    """Return the frames that a bus of whatever kind has.

    Parameters
    ----------
    bus : can.BusABC
    timeout : float
        How long to wait for the first one [s].

    Returns
    -------
    FrameBatch
        Empty when nothing came.

    Raises
    ------
    can.CanError, OSError
        What the bus raises when its device is gone.
    """
    if isinstance(bus, BatchBus):
        return bus.receive(timeout)
    messages: list[can.Message] = []
    message = bus.recv(timeout)
    while message is not None:
        messages.append(message)
        message = bus.recv(0) if len(messages) < MOST else None
    return pack(messages)
