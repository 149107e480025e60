# SPDX-License-Identifier: Apache-2.0
"""Read and write the objects of one drive, with every failure as a :class:`HardwareError`.

SDO waits for its answer on the thread that reads the bus. Called from a PDO callback it would wait
for itself and run into its time-out, so nothing here may be used in one; set-up happens before the
stream starts, and the stream is decoded from frames, never through ``canopen``.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import Any

import can
import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError, SdoError

from comcal.errors import HardwareError
from comcal_drivers.canopen_setup.objects import object_text

# Its complaints about single transfers would be printed to the terminal; ours say what they mean.
logging.getLogger("canopen").addHandler(logging.NullHandler())

TIMEOUT = 0.3
"""An SDO server that is alive answers within milliseconds [s]."""

ATTEMPTS = 2
NOT_THERE = frozenset({0x06020000, 0x06090011})
"""Abort codes: the object, or the subindex, does not exist."""

OUT_OF_STEP = frozenset({0x05030000, 0x05040000, 0x05040001})
"""Abort codes: toggle bit, time-out, unknown command; after a late answer, the transfer's own."""

NOTIFIER_CYCLE = 0.02
"""How soon the thread that reads notices that it shall end [s]."""

SDO_REPLY, SDO_REQUEST, HEARTBEAT, EMERGENCY = 0x580, 0x600, 0x700, 0x080


class Drive:
    """One node of a CANopen network, seen through its SDO server.

    Calls from several threads take turns.

    Parameters
    ----------
    network : canopen.Network
        Connected; see :func:`open_network`.
    node : int
    name : str
        What error messages call the drive: the joint.
    timeout : float
        How long one answer may take [s]; asked twice.
    """

    def __init__(
        self, network: canopen.Network, node: int, name: str = "", timeout: float = TIMEOUT
    ) -> None:
        self.node = node
        self.name = name
        self.timeout = timeout
        self._network = network
        self._turn = threading.Lock()
        self.remote: Any = canopen.RemoteNode(node, canopen.ObjectDictionary())
        self.remote.sdo.RESPONSE_TIMEOUT = timeout
        self.remote.sdo.MAX_RETRIES = 1
        network.add_node(self.remote)

    def __str__(self) -> str:
        return f"{self.name} (node {self.node})" if self.name else f"node {self.node}"

    def read(self, index: int, subindex: int = 0, *, signed: bool = False) -> int:
        """Return the value of an integer object.

        Raises
        ------
        HardwareError
            If the drive refuses, has no such object, or does not answer in time.
        """
        return int.from_bytes(self.read_bytes(index, subindex), "little", signed=signed)

    def read_optional(self, index: int, subindex: int = 0, *, signed: bool = False) -> int | None:
        """Return the value of an integer object, or None where the drive does not have it."""
        try:
            return self.read(index, subindex, signed=signed)
        except MissingObjectError:
            return None

    def read_bytes(self, index: int, subindex: int = 0) -> bytes:
        """Return an object as it is: the text of 0x1008, say."""
        with self._turn, self._failures("read", index, subindex):
            return bytes(self._patiently(lambda: self.remote.sdo.upload(index, subindex)))

    def write(self, index: int, value: int, size: int, *, subindex: int = 0) -> None:
        """Write an integer object of *size* bytes; negative values as two's complement.

        Raises
        ------
        HardwareError
            If the drive refuses, has no such object, or does not answer in time.
        """
        data = value.to_bytes(size, "little", signed=value < 0)
        with self._turn, self._failures(f"write {value} to", index, subindex):
            self._patiently(lambda: self.remote.sdo.download(index, subindex, data))

    def send_write(self, index: int, value: int, size: int) -> None:
        """Send a write without waiting for its answer, or for the turn of another thread.

        For what must not wait: the quick stop. Whether it was obeyed is to be read afterwards.
        """
        request = bytes([0x23 | (4 - size) << 2, index & 0xFF, index >> 8, 0])
        data = value.to_bytes(size, "little", signed=value < 0).ljust(4, b"\0")
        try:
            self._network.send_message(SDO_REQUEST + self.node, request + data)
        except (can.CanError, OSError) as error:
            raise self.failure(f"cannot be reached: {error}") from error

    def failure(self, what: str, **evidence: str) -> HardwareError:
        """Return an error about this drive."""
        return HardwareError(f"the drive {what}", where=str(self), **evidence)

    def _patiently(self, transfer: Callable[[], Any]) -> Any:
        """Carry out a transfer, again where it was answered by another answer or not at all.

        An answer to :meth:`send_write` may come in between: nobody waited for it.
        """
        deadline = time.monotonic() + ATTEMPTS * self.timeout
        while True:
            try:
                return transfer()
            except (SdoCommunicationError, SdoAbortedError) as error:
                is_final = isinstance(error, SdoAbortedError) and error.code not in OUT_OF_STEP
                if is_final or time.monotonic() >= deadline:
                    raise

    @contextmanager
    def _failures(self, verb: str, index: int, subindex: int) -> Generator[None]:
        thing = object_text(index, subindex)
        try:
            yield
        except SdoAbortedError as error:
            kind = MissingObjectError if error.code in NOT_THERE else HardwareError
            raise kind(
                f"the drive refuses to {verb} {thing}: {error}",
                where=str(self),
                next_step="check in the manual of the drive that it has this object in its "
                "present state",
            ) from error
        except SdoError as error:
            raise self.failure(
                f"does not answer when asked to {verb} {thing}: {error}",
                limit=f"{self.timeout:g} s",
                next_step="check its power, its node number and the bit rate of the bus",
            ) from error
        except (can.CanError, OSError, RuntimeError) as error:
            raise self.failure(
                f"cannot be reached: {error}", next_step="check the adapter and the cable"
            ) from error


class MissingObjectError(HardwareError):
    """The drive does not have the object asked for."""


@contextmanager
def open_network(bus: can.BusABC, nodes: Sequence[int]) -> Generator[canopen.Network]:
    """Run CANopen services over an open bus, which stays open afterwards.

    Nothing else may read the bus meanwhile: each answer is delivered once.

    Parameters
    ----------
    bus : can.BusABC
        Filtered to what set-up needs, then restored to receive everything.
    nodes : sequence of int
        Whose answers are let through.
    """
    network = canopen.Network(bus)
    network.NOTIFIER_CYCLE = NOTIFIER_CYCLE
    bus.set_filters(
        [
            {"can_id": base + node, "can_mask": 0x7FF, "extended": False}
            for node in nodes
            for base in (SDO_REPLY, HEARTBEAT, EMERGENCY)
        ]
    )
    network.notifier = can.Notifier(bus, network.listeners, network.NOTIFIER_CYCLE)
    try:
        yield network
    finally:
        network.notifier.stop(network.NOTIFIER_SHUTDOWN_TIMEOUT)
        bus.set_filters(None)
