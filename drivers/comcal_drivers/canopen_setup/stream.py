# SPDX-License-Identifier: Apache-2.0
"""Make drives send: NMT start, and SYNC where nobody else gives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import can

from comcal.errors import HardwareError

NMT, SYNC = 0x000, 0x080
START, PRE_OPERATIONAL = 0x01, 0x80


@dataclass
class Streaming:
    """Drives that send; :meth:`stop` ends it.

    Parameters
    ----------
    bus : can.BusABC
    nodes : sequence of int
    sync : task of python-can or None
        Sends SYNC until it is stopped.
    """

    bus: can.BusABC
    nodes: Sequence[int]
    sync: Any | None = None

    def stop(self, *, leave_running: bool = True) -> None:
        """End the SYNC; callable repeatedly.

        Parameters
        ----------
        leave_running : bool
            Whether the nodes stay operational. Sending them to PRE-OPERATIONAL also stops
            whatever else uses their PDOs, a controller that balances the robot among it.
        """
        if self.sync is not None:
            self.sync.stop()
            self.sync = None
        if not leave_running:
            for node in self.nodes:
                _send(self.bus, NMT, bytes([PRE_OPERATIONAL, node]))


def start_streaming(
    bus: can.BusABC, nodes: Sequence[int], sync_period: float | None = None
) -> Streaming:
    """Bring nodes to OPERATIONAL and begin to send SYNC.

    Parameters
    ----------
    bus : can.BusABC
        Only sent to: who reads it does not matter.
    nodes : sequence of int
    sync_period : float or None
        Seconds between two SYNC; None where another master sends it, or no PDO asks for it.

    Raises
    ------
    HardwareError
        If the bus does not take the frames.
    """
    for node in nodes:
        _send(bus, NMT, bytes([START, node]))
    if sync_period is None:
        return Streaming(bus, nodes)
    try:
        task = bus.send_periodic(_frame(SYNC, b""), sync_period)
    except (can.CanError, OSError, ValueError) as error:
        raise _unreachable(bus, error) from error
    return Streaming(bus, nodes, task)


def _frame(identifier: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def _send(bus: can.BusABC, identifier: int, data: bytes) -> None:
    try:
        bus.send(_frame(identifier, data), timeout=0.5)
    except (can.CanError, OSError) as error:
        raise _unreachable(bus, error) from error


def _unreachable(bus: can.BusABC, error: Exception) -> HardwareError:
    return HardwareError(
        f"the bus takes no frames: {error}",
        where=str(bus.channel_info),
        next_step="check the adapter, the cable, the bit rate, and that a drive is switched on",
    )
