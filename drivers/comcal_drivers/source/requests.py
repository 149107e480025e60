# SPDX-License-Identifier: Apache-2.0
"""Polling: devices that speak when they are asked, or at a SYNC, are asked once a period."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import can

from comcal.errors import ComcalError
from comcal_drivers.devices.configuration import DeviceConfig, JointConfig
from comcal_drivers.frames.batch import EXTENDED

SYNC = 0x080
"""Identifier at which CANopen nodes send what follows SYNC."""


@dataclass(frozen=True)
class Request:
    """A frame that is sent every ``period`` seconds; ``id`` as in FrameBatch."""

    period: float
    id: int
    data: bytes = b""


def requests_of(devices: Sequence[DeviceConfig]) -> tuple[Request, ...]:
    """Return what the devices of one bus have to be asked, SYNC once for all of them."""
    found: list[Request] = []
    syncs: list[float] = []
    for config in devices:
        request = config.device.description.join.request
        if request is not None and config.period is not None:
            number = config.device.relocate(request.id)
            data = bytes(request.data).ljust(request.length, b"\0")
            found.append(Request(config.period, number, data))
        if isinstance(config, JointConfig) and config.sync_period is not None:
            syncs.append(config.sync_period)
    return (*found, *([Request(min(syncs), SYNC)] if syncs else []))


class Poller:
    """Sends the requests of one bus in a thread of its own.

    A request that cannot be sent is passed over: that the device is silent then shows, and is
    told, where its samples are missed.

    Parameters
    ----------
    send : callable
    requests : sequence of Request
    """

    def __init__(self, send: Callable[[can.Message], None], requests: Sequence[Request]) -> None:
        self._send, self._requests = send, tuple(requests)
        self._stop = threading.Event()
        self.failed = 0
        """Requests that could not be sent."""
        self._thread: threading.Thread | None = None
        if self._requests:
            self._thread = threading.Thread(target=self._run, name="poll", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop polling."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def _run(self) -> None:
        due = [time.monotonic()] * len(self._requests)
        while not self._stop.wait(max(0.0, min(due) - time.monotonic())):
            now = time.monotonic()
            for k, request in enumerate(self._requests):
                if due[k] > now:
                    continue
                # What was missed while the program was busy is not made up for.
                due[k] = max(due[k] + request.period, now)
                message = can.Message(
                    arbitration_id=request.id & ~int(EXTENDED),
                    is_extended_id=bool(request.id & int(EXTENDED)),
                    data=request.data,
                )
                try:
                    self._send(message)
                except (ComcalError, can.CanError, OSError):
                    self.failed += 1
