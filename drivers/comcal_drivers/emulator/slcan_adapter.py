# SPDX-License-Identifier: Apache-2.0
"""A serial-line CAN adapter behind a pseudo-terminal of the kernel."""

from __future__ import annotations

import fcntl
import os
import tempfile
import termios
import tty
from collections.abc import Mapping, Sequence
from pathlib import Path

from comcal.errors import UsageError
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.outbox import Outbox
from comcal_drivers.emulator.slcan_protocol import (
    BUS_ERROR,
    OVERRUN,
    RX_FULL,
    SlcanChannel,
    slcan_line,
)

_READ = 4096


class SlcanAdapter:
    """An adapter that a host reaches through a serial port.

    The port keeps its name while the adapter is unplugged and plugged in again, as the links that
    udev makes do; behind the name is a new terminal each time.

    Parameters
    ----------
    bus : str
        Its name in robot.yaml.
    bitrate : int
        What the host has to ask for [bit/s].
    fifo : int
        Frames that fit into the adapter; more are lost and noted in the status flags. Zero: the
        bus waits for the host.
    directory : Path, optional
        Where the port is, called as the bus is; a new temporary one otherwise.

    Raises
    ------
    UsageError
        If something else than a port is there, or there is no such directory.
    """

    def __init__(
        self, bus: str, bitrate: int = 1_000_000, fifo: int = 0, directory: Path | None = None
    ) -> None:
        self._bitrate = bitrate
        self._fifo = fifo
        self._is_temporary = directory is None
        self._directory = directory or Path(tempfile.mkdtemp(prefix="comcal-emulator-"))
        self._port = self._directory / bus
        if not self._directory.is_dir() or (self._port.exists() and not self._port.is_symlink()):
            raise UsageError(
                "no serial port can be made here",
                where=str(self._port),
                next_step="name another folder that exists",
            )
        self._port.unlink(missing_ok=True)  # of an emulator that was killed
        self._master = self._slave = -1
        self._channel = SlcanChannel()
        self._outbox = Outbox(self._write)
        self.lost = 0
        self.connect()

    @property
    def connection(self) -> Mapping[str, object]:
        """Interface, serial port and bit rate."""
        return {"interface": "slcan", "channel": str(self._port), "bitrate": self._bitrate}

    @property
    def is_open(self) -> bool:
        """Whether the host opened the channel."""
        return self._channel.is_open

    @property
    def backlog(self) -> int:
        """Lines that the terminal did not take yet."""
        return len(self._outbox)

    @property
    def unread(self) -> int:
        """Bytes that lie in the terminal, unread by the host."""
        if self._slave < 0:
            return 0
        count = fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4))
        return int.from_bytes(count, "little")

    @property
    def fds(self) -> tuple[list[int], list[int]]:
        """The adapter's end of the terminal."""
        if self._master < 0:
            return [], []
        return [self._master], [self._master] if self._outbox else []

    def receive(self) -> list[Frame]:
        """Obey the commands of the host; return the frames among them."""
        frames = list[Frame]()
        while self._master >= 0:
            try:
                received = os.read(self._master, _READ)
            except OSError:  # nothing there
                break
            was_open = self._channel.is_open
            answers, sent = self._channel.feed(received)
            if was_open and not self._channel.is_open:
                self._outbox.clear()
            self._outbox.put(answers)
            frames += sent
        return frames

    def send(self, frames: Sequence[Frame]) -> None:
        """Queue frames; lost while the channel is closed, or when the queue is full."""
        if not self._channel.is_open:
            return
        for frame in frames:
            if self._fifo and len(self._outbox) >= self._fifo:
                self._channel.flags |= RX_FULL | OVERRUN
                self.lost += 1
                continue
            self._outbox.put(slcan_line(frame, stamped=self._channel.stamped))

    def flush(self) -> None:
        """Write as much as the terminal takes."""
        if self._master >= 0:
            self._outbox.flush()

    def disconnect(self) -> None:
        """Hang up the terminal and take its name away."""
        self._port.unlink(missing_ok=True)
        for fd in (self._master, self._slave):
            if fd >= 0:
                os.close(fd)
        self._master = self._slave = -1

    def connect(self) -> None:
        """Make a new terminal under the old name, with the channel closed."""
        if self._master >= 0:
            return
        self._master, self._slave = os.openpty()
        # Kept open here: the settings of a terminal that nobody holds are forgotten, and it would
        # echo what the adapter sends.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._channel = SlcanChannel()
        self._outbox = Outbox(self._write)
        self._port.symlink_to(os.ttyname(self._slave))

    def note_bus_off(self) -> None:
        """Set the bus-error flag; this protocol has no error frames."""
        self._channel.flags |= BUS_ERROR

    def close(self) -> None:
        """Hang up and remove the port."""
        self.disconnect()
        if self._is_temporary and self._directory.is_dir():
            self._directory.rmdir()

    def _write(self, text: bytes) -> int:
        return os.write(self._master, text)
