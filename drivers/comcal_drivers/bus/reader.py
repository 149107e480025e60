# SPDX-License-Identifier: Apache-2.0
"""Read a bus in the background: log first, hand over second, and never lose silently.

Two threads, so that a slow disk does not make the adapter overflow: one takes frames from the
bus, the other writes them to the log and puts them where :meth:`BusReader.take` finds them.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Protocol

import can

from comcal.errors import ComcalError, HardwareError
from comcal_drivers.bus.batch_bus import receive
from comcal_drivers.bus.error_frames import gap_marker
from comcal_drivers.bus.frame_queue import FrameQueue
from comcal_drivers.bus.health import BusHealth
from comcal_drivers.bus.open import open_bus
from comcal_drivers.bus.watch import Watch
from comcal_drivers.devices.configuration import BusConfig
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.messages import pack

POLL = 0.05
"""How long a thread waits at most before it looks whether it shall stop [s]."""
PACE = 0.001
"""Frames that come within this time are handled together [s]."""
MANY = 64
"""So many at once are what had to wait: there are more behind them, and no time to lose."""
SEND_TIME = 0.5
"""How long sending may take [s]."""
FIRST_PAUSE, LONGEST_PAUSE = 0.1, 2.0
"""Before the device is tried again [s]; doubles every time."""
CLOSE_TIME = 5.0
"""How long each thread gets to finish [s]; a disk may be slow."""


_PLUG_IN = "see that the adapter is plugged in and powered, then start again"


class Log(Protocol):
    """Where raw frames are written, such as ``FrameLog``."""

    def write(self, batch: FrameBatch, channel: str) -> None:
        """Append frames of the bus *channel*; raise OSError where that fails."""
        ...


class BusReader:
    """Reads one bus until it is closed; a device that goes is looked for until it is back.

    Use as a context manager, or call :meth:`close`.

    Parameters
    ----------
    config : BusConfig
    log : Log, optional
        Frames are written here before they are handed over. It is not closed.
    queue_limit : int
        Frames that wait for :meth:`take`, and as many for the log; more are dropped and counted.
    silence_after : float
        How long nothing may come before that counts as a silence [s].
    opener : callable
        Opens the bus, the first time in the caller's thread.

    Raises
    ------
    ConfigError, HardwareError, MissingExtraError
        See :func:`~comcal_drivers.bus.open.open_bus`.
    """

    def __init__(
        self,
        config: BusConfig,
        log: Log | None = None,
        *,
        queue_limit: int = 200_000,
        silence_after: float = 0.5,
        opener: Callable[[BusConfig], can.BusABC] = open_bus,
    ) -> None:
        self._config, self._log, self._opener = config, log, opener
        self._inbox, self._outbox = FrameQueue(queue_limit), FrameQueue(queue_limit)
        self._watch = Watch(silence_after, time.monotonic())
        self._sent = self._reconnects = self._lost_earlier = self._garbage_earlier = 0
        self._exception = ""
        self._failure: BaseException | None = None
        self._is_failure_told = False
        self._stop = threading.Event()
        self._bus: can.BusABC | None = opener(config)
        self._receiver = self._thread(self._receive, "receive")
        self._writer = self._thread(self._write, "log")

    def take(self, wait: float = 0.0) -> FrameBatch:
        """Return all frames since the last time.

        Parameters
        ----------
        wait : float
            How long to wait for the first one [s].

        Returns
        -------
        FrameBatch
            In the order in which they were received and sent. An error frame "receive overflow"
            stands where frames were lost (:func:`~comcal_drivers.bus.error_frames.is_gap`).

        Raises
        ------
        HardwareError
            The log cannot be written; nothing is accepted from then on.
        """
        self._tell()
        batch = self._outbox.take(wait)
        self._tell()
        return batch

    def send(self, message: can.Message) -> None:
        """Send a message; it stands in the log before anything that answers it.

        Parameters
        ----------
        message : can.Message

        Raises
        ------
        HardwareError
            The device is away, or takes nothing.
        """
        self._tell()
        bus = self._bus
        if bus is None:
            raise self._error("nothing can be sent, the device is away", self._exception, _PLUG_IN)
        message.is_rx, message.timestamp = False, time.time()
        slot = self._inbox.reserve(pack([message]))
        is_sent = False
        try:
            bus.send(message, SEND_TIME)
            is_sent = True
        except (can.CanError, OSError) as error:
            raise self._error(
                f"frame {message.arbitration_id:X} cannot be sent",
                str(error),
                "see that the bus has a second node that acknowledges, and both terminators",
            ) from error
        finally:
            self._inbox.settle(slot, keep=is_sent)
        self._sent += 1

    def health(self) -> BusHealth:
        """Return how the bus is doing."""
        bus, watch = self._bus, self._watch
        return BusHealth(
            name=self._config.name,
            frames=watch.frames,
            sent=self._sent,
            error_frames=watch.error_frames,
            bus_off=watch.bus_off,
            bus_offs=watch.bus_offs,
            lost_by_kernel=self._lost_earlier + int(getattr(bus, "lost", 0)),
            lost_before_log=self._inbox.dropped,
            dropped_by_queue=self._outbox.dropped,
            garbage=self._garbage_earlier + int(getattr(bus, "garbage", 0)),
            silences=watch.silences,
            is_silent=watch.is_silent,
            is_connected=bus is not None,
            reconnects=self._reconnects,
            last_seen=watch.last_seen,
            receive_buffer=int(getattr(bus, "receive_buffer", 0)),
            exception=self._exception,
        )

    def close(self) -> None:
        """Stop reading, write what has come to the log and close the bus.

        Frames that were not taken can be taken afterwards.

        Raises
        ------
        HardwareError
            The log could not be written, and nobody was told yet.
        """
        self._stop.set()
        self._receiver.join(CLOSE_TIME)
        self._inbox.close()
        self._writer.join(CLOSE_TIME)
        self._outbox.close()
        for thread, what in (
            (self._receiver, "the bus does not close"),
            (self._writer, "the log is stuck"),
        ):
            if thread.is_alive() and self._failure is None:
                self._fail(self._error(what, f"waited {CLOSE_TIME:g} s", _PLUG_IN))
        if not self._is_failure_told:
            self._tell()

    def __enter__(self) -> BusReader:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # What is under way already matters more than what closing finds.
        with contextlib.suppress(ComcalError) if kind is not None else contextlib.nullcontext():
            self.close()

    # --- the thread that receives --------------------------------------------------------------

    def _receive(self) -> None:
        try:
            while not self._stop.is_set():
                if self._bus is None:
                    self._reconnect()
                else:
                    self._receive_once(self._bus)
        finally:
            self._let_go()
            self._inbox.close()

    def _receive_once(self, bus: can.BusABC) -> None:
        began = time.monotonic()
        try:
            batch = receive(bus, POLL)
        except (can.CanError, OSError) as error:
            self._exception = str(error) or type(error).__name__
            self._let_go()
            return
        now = time.monotonic()
        self._watch.see(batch, now, time.time())
        self._inbox.put(batch)
        # Under load frames are handled by the millisecond, not one by one.
        if 0 < len(batch) < MANY and now - began < PACE:
            time.sleep(PACE - (now - began))

    def _reconnect(self) -> None:
        pause = FIRST_PAUSE
        while not self._stop.wait(pause):
            try:
                self._bus = self._opener(self._config)
            except HardwareError as error:
                self._exception = str(error)
                pause = min(2 * pause, LONGEST_PAUSE)
                continue
            self._reconnects += 1
            self._watch.restart(time.monotonic())
            self._inbox.put(gap_marker(time.time()))
            return

    def _let_go(self) -> None:
        bus, self._bus = self._bus, None
        if bus is None:
            return
        self._lost_earlier += int(getattr(bus, "lost", 0))
        self._garbage_earlier += int(getattr(bus, "garbage", 0))
        # It is gone: what it says to that is no news.
        with contextlib.suppress(can.CanError, OSError):
            bus.shutdown()

    # --- the thread that logs ------------------------------------------------------------------

    def _write(self) -> None:
        while True:
            is_last = not self._receiver.is_alive()
            batch = self._inbox.take(POLL)
            if len(batch):
                self._log_and_pass_on(batch)
            elif is_last and len(self._inbox) == 0:
                return

    def _log_and_pass_on(self, batch: FrameBatch) -> None:
        if self._log is not None:
            try:
                self._log.write(batch, self._config.name)
            except HardwareError:
                raise
            except OSError as error:
                raise self._error(
                    "the frames cannot be written to the log, nothing is read any more",
                    str(error),
                    "make room on the disk and record the pose again",
                ) from error
        self._outbox.put(batch)

    # --- failures ------------------------------------------------------------------------------

    def _thread(self, work: Callable[[], None], name: str) -> threading.Thread:
        def run() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001
                # Whoever calls next is told.
                self._fail(error)

        thread = threading.Thread(target=run, name=f"{self._config.name} {name}", daemon=True)
        thread.start()
        return thread

    def _fail(self, error: BaseException) -> None:
        if self._failure is None:
            self._failure = error
            self._exception = str(error) or type(error).__name__
        self._stop.set()
        self._outbox.close()

    def _tell(self) -> None:
        if self._failure is not None:
            self._is_failure_told = True
            raise self._failure

    def _error(self, what: str, measured: str, next_step: str) -> HardwareError:
        return HardwareError(
            what, where=f"bus {self._config.name}", measured=measured, next_step=next_step
        )
