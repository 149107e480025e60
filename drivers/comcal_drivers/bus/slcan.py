# SPDX-License-Identifier: Apache-2.0
"""Serial-line CAN adapters (CANable, CANtact, Lawicel CANUSB, USBtin, ...), read in bulk.

An adapter whose own queue runs over drops frames without a word, unless it is asked: it is, every
half second, until it refuses. An error frame tells what it answers, later than it happened.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
from typing import cast

import can
import serial

from comcal_drivers.bus.batch_bus import BatchBus
from comcal_drivers.bus.slcan_lines import SlcanLines, slcan_line
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.batches import concatenate

BITRATES = {
    10_000: "S0",
    20_000: "S1",
    50_000: "S2",
    100_000: "S3",
    125_000: "S4",
    250_000: "S5",
    500_000: "S6",
    800_000: "S7",
    1_000_000: "S8",
}
"""Bit rates that the protocol has a command for [bit/s]."""

READ_SIZE = 1 << 16
ANSWER_TIME = 0.25
"""How long an adapter may take to answer a command [s]."""
OPENINGS = 2
"""So often a channel is opened: a late answer to the one before may be taken for a refusal."""
BOOT_TIME = 2.5
"""How long a board that restarts when its port is opened may stay silent [s]."""
FLAGS_PERIOD = 0.5
"""How often an adapter is asked what went wrong [s]."""
WRITE_TIME = 0.5
"""How long a write may wait for the adapter [s]."""


class SlcanBus(BatchBus):
    """A serial-line CAN adapter.

    Parameters
    ----------
    channel : str
        Serial device, such as ``/dev/ttyACM0``.
    bitrate : int, optional
        Bit rate of the CAN bus [bit/s]; without it the adapter keeps its own.
    tty_baudrate : int
        Baud rate of the serial line [bit/s]; adapters that are USB devices ignore it.
    rtscts : bool
        Whether the serial line has hardware handshake.
    listen_only : bool
        Never acknowledge and never send.

    Raises
    ------
    serial.SerialException
        The device cannot be opened.
    ValueError
        The protocol has no command for the bit rate.
    can.CanInitializationError
        The adapter refuses the bit rate or to open.
    """

    def __init__(
        self,
        channel: str,
        bitrate: int | None = None,
        tty_baudrate: int = 115_200,
        *,
        rtscts: bool = False,
        listen_only: bool = False,
    ) -> None:
        if bitrate is not None and bitrate not in BITRATES:
            raise ValueError(
                f"slcan has no bit rate of {bitrate} bit/s, only {', '.join(map(str, BITRATES))}"
            )
        self._lines = SlcanLines()
        self._early: list[FrameBatch] = []
        self._writing = threading.Lock()
        self._port = serial.Serial(
            channel,
            tty_baudrate,
            timeout=0,
            write_timeout=WRITE_TIME,
            rtscts=rtscts,
            exclusive=True,
        )
        try:
            self._open_channel(bitrate, "L" if listen_only else "O")
        except BaseException:
            self._port.close()
            raise
        self._asked, self._refusals = time.monotonic(), self._lines.refusals
        super().__init__(channel)

    @property
    def garbage(self) -> int:
        """Lines that were no frames and no answers: bytes were lost on the serial line."""
        return self._lines.garbage

    def receive(self, timeout: float) -> FrameBatch:
        """Return the frames that are there; see :meth:`BatchBus.receive`."""
        self._ask_flags()
        # Frames that came together with the answer to the last command.
        early, self._early = concatenate(self._early), []
        if len(early):
            return early
        received = self._read(timeout)
        return self._lines.feed(received, time.time())

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message.

        Parameters
        ----------
        msg : can.Message
        timeout : float, optional
            Ignored: writing takes at most :data:`WRITE_TIME`.

        Raises
        ------
        can.CanOperationError
            The adapter takes no more bytes, or is gone.
        """
        try:
            with self._writing:
                self._port.write(slcan_line(msg))
        except serial.SerialException as error:
            raise can.CanOperationError(f"the adapter takes no more bytes: {error}") from error

    def fileno(self) -> int:
        """Return the file descriptor of the serial line."""
        return int(self._port.fileno())

    def shutdown(self) -> None:
        """Close the adapter's channel and the serial line, whether it is still there or not."""
        if self._is_shutdown:
            return
        super().shutdown()
        # Where the adapter is gone already there is nothing to close.
        with contextlib.suppress(OSError):
            os.write(self._port.fileno(), b"C\r")
        self._port.close()

    def _ask_flags(self) -> None:
        now = time.monotonic()
        if now - self._asked < FLAGS_PERIOD or self._lines.refusals > self._refusals:
            return
        # Never waits: what is written meanwhile goes first, and a full line can be asked later.
        if self._writing.acquire(blocking=False):
            with contextlib.suppress(OSError):
                os.write(self._port.fileno(), b"F\r")
            self._writing.release()
            self._asked = now

    def _read(self, timeout: float) -> bytes:
        try:
            fd = cast("int | None", self._port.fileno())
            if fd is None:
                raise can.CanOperationError("the adapter is gone: its port is being closed")
            if not select.select([fd], [], [], timeout)[0]:
                return b""
            received = os.read(fd, READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise can.CanOperationError(f"the adapter is gone: {error}") from error
        if not received:
            raise can.CanOperationError("the adapter is gone: end of file")
        return received

    def _open_channel(self, bitrate: int | None, opening: str) -> None:
        commands = ([BITRATES[bitrate]] if bitrate is not None else []) + [opening]
        refused = None
        for _ in range(OPENINGS):
            # A closed channel may answer this by a bell; both say that somebody is listening.
            deadline = time.monotonic() + BOOT_TIME
            while not self._ask("C") and time.monotonic() < deadline:
                pass
            self._drain()
            refused = next((command for command in commands if self._is_refused(command)), None)
            if refused is None:
                return
        raise can.CanInitializationError(f"the adapter refuses the command {refused}")

    def _is_refused(self, command: str) -> bool:
        refusals = self._lines.refusals
        self._ask(command)
        return self._lines.refusals > refusals

    def _ask(self, command: str) -> bool:
        """Send a command; return whether there was an answer (some adapters never give one)."""
        answers = self._lines.answers
        self._port.write(f"{command}\r".encode("ascii"))
        deadline = time.monotonic() + ANSWER_TIME
        while (left := deadline - time.monotonic()) > 0 and self._lines.answers == answers:
            self._early.append(self._lines.feed(self._read(left), time.time()))
        return self._lines.answers > answers

    def _drain(self) -> None:
        """Forget what was sent before the channel was closed, a line cut in two included."""
        deadline = time.monotonic() + ANSWER_TIME
        while self._read(0.02) and time.monotonic() < deadline:
            pass
        self._lines, self._early = SlcanLines(), []
