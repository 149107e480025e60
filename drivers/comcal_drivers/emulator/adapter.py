# SPDX-License-Identifier: Apache-2.0
"""What every emulated adapter can do, whatever the host sees of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from comcal_drivers.emulator.frame import Frame


class Adapter(Protocol):
    """Carries frames between one emulated bus and a host; never blocks."""

    @property
    def connection(self) -> Mapping[str, object]:
        """What ``sources.can.buses`` of robot.yaml says to reach it."""
        ...

    @property
    def is_open(self) -> bool:
        """Whether a host listens; what is sent to nobody is lost, as on a real bus."""
        ...

    @property
    def backlog(self) -> int:
        """Frames that the host has not taken yet, as far as this can be seen from here."""
        ...

    @property
    def fds(self) -> tuple[list[int], list[int]]:
        """File descriptors to wait for: readable, writable; both empty where there are none."""
        ...

    def receive(self) -> list[Frame]:
        """Return what the host sent to the bus since the last call."""
        ...

    def send(self, frames: Sequence[Frame]) -> None:
        """Queue frames for the host."""
        ...

    def flush(self) -> None:
        """Pass on as much of the queue as the host takes now."""
        ...

    def disconnect(self) -> None:
        """Vanish, as an unplugged adapter does; its queue is lost."""
        ...

    def connect(self) -> None:
        """Come back under the same name."""
        ...

    def note_bus_off(self) -> None:
        """Remember a bus error for hosts that ask the adapter for it."""
        ...

    def close(self) -> None:
        """Leave nothing behind."""
        ...
