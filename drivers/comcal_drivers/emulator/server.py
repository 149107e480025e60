# SPDX-License-Identifier: Apache-2.0
"""The loop of an emulator process: hear, speak, wait; a single thread, and nothing blocks."""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from comcal_drivers.emulator.adapter import Adapter
from comcal_drivers.emulator.frame import ERROR, Frame
from comcal_drivers.emulator.injector import Injector, Outage
from comcal_drivers.emulator.robot import (
    ABORT,
    ARRIVED,
    MOVE,
    MOVING,
    NOWHERE,
    REFUSED,
    EmulatedRobot,
    Tick,
    command_of,
    state_frame,
)

BACKLOG = 256
"""Frames that may wait for a host before the robot waits for it, too."""
PATIENCE = 0.1
"""Longest wait without a look at the leash [s]."""
VIRTUAL_PATIENCE = 0.002
"""Longest wait where an adapter has no file to wait for [s]."""
BURST = 64
"""Moments that are said in one round of the loop, at most."""
DRAIN = 0.5
"""How long what is on its way may still arrive before the plug is pulled [s]."""
QUIET = 0.02
"""How long nothing was on its way when everything has arrived: kernels pass on in steps [s]."""
BUS_OFF = 0x040
"""Class of the error frame."""

Notice = Callable[[str], None]


@dataclass
class _Line:
    """One bus: its adapter, its faults, and until when nothing passes."""

    adapter: Adapter
    injector: Injector
    dead_until: float = 0.0
    is_unplugged: bool = False


@dataclass
class _Due:
    """A move that takes time."""

    pose: int
    planned_as: int | None
    at: float


class Server:
    """Lets hosts talk to an emulated robot.

    Parameters
    ----------
    robot : EmulatedRobot
    adapters : mapping from bus to Adapter
    injectors : mapping from bus to Injector
        For every bus.
    rate : float
        Seconds of the robot's clock per second; zero: as fast as the hosts listen.
    move_time : float
        How long a move takes [s].
    clock_device : str
        Device whose count is announced with a new pose.
    notice : callable
        Told about what a person at the emulator should know.
    """

    def __init__(
        self,
        robot: EmulatedRobot,
        adapters: Mapping[str, Adapter],
        injectors: Mapping[str, Injector],
        *,
        rate: float = 1.0,
        move_time: float = 0.0,
        clock_device: str = "",
        notice: Notice = lambda text: None,
    ) -> None:
        self._robot = robot
        self._lines = {bus: _Line(adapters[bus], injectors[bus]) for bus in adapters}
        self._rate = rate
        self._move_time = move_time
        self._clock_device = clock_device
        self._notice = notice
        self._due: _Due | None = None
        self._next: Tick | None = None
        self._start: tuple[float, float] | None = None  # wall clock, robot's clock
        self._t = 0.0

    def run(self, is_over: Callable[[], bool]) -> None:
        """Serve until *is_over* says so."""
        for bus, frames in self._robot.boot().items():
            self._send(bus, frames)
        while not is_over():
            now = time.monotonic()
            self._revive(now)
            self._hear(now)
            self._speak(now)
            for line in self._lines.values():
                line.adapter.flush()
            self._wait()

    def close(self) -> None:
        """Close all adapters."""
        for line in self._lines.values():
            line.adapter.close()

    def stand(self, pose: int, planned_as: int | None = None) -> None:
        """Take a pose now, and say so on every bus."""
        for line in self._lines.values():
            self._pass_on(line, line.injector.release())
        move = self._robot.take(pose, planned_as)
        self._next = None
        self._start = None
        for line in self._lines.values():
            line.injector.begin(pose)
        count = move.count
        for line in self._lines.values():
            count = line.injector.announced(self._clock_device, count)
        if move.state == REFUSED:
            self._notice(f"pose {pose} refused: {move.reason}")
        self._say(state_frame(pose, move.state, count, self._t))

    # Hear

    def _hear(self, now: float) -> None:
        for bus, line in self._lines.items():
            frames = line.adapter.receive()
            if now < line.dead_until:
                continue
            for frame in frames:
                command = command_of(frame)
                if command is None:
                    answers = self._robot.hear(bus, frame)
                    self._send(bus, [a._replace(t=self._t) if a.t == 0.0 else a for a in answers])
                else:
                    self._obey(*command, now)
        commanded = self._robot.commanded
        if commanded is not None and self._due is None:
            self._obey(commanded, MOVE, None, now)
        if self._due is not None and now >= self._due.at:
            due, self._due = self._due, None
            self.stand(due.pose, due.planned_as)

    def _obey(self, pose: int, command: int, planned_as: int | None, now: float) -> None:
        if command == MOVE:
            self._say(state_frame(pose, MOVING, 0, self._t))
            if self._move_time > 0.0:
                self._due = _Due(pose, planned_as, now + self._move_time)
            else:
                self.stand(pose, planned_as)
        elif command == ABORT:
            if self._due is not None:
                self._due = None
                self._say(state_frame(pose, REFUSED, self._robot.count, self._t))
            else:
                at = self._robot.pose
                state = REFUSED if at is None else ARRIVED
                here = NOWHERE if at is None else at
                self._say(state_frame(here, state, self._robot.count, self._t))

    # Speak

    def _speak(self, now: float) -> None:
        for _ in range(BURST):
            if not self._may_speak(now):
                return
            tick = self._next or self._robot.tick()
            self._next = tick
            if tick is None or not self._is_due(tick, now):
                return
            self._next = None
            self._t = tick.t
            for bus, frames in tick.frames.items():
                line = self._lines[bus]
                self._pass_on(line, line.injector.inject(frames))

    def _may_speak(self, now: float) -> bool:
        lines = self._lines.values()
        if any(line.adapter.backlog >= BACKLOG for line in lines):
            return False
        if self._rate > 0.0:
            return True
        # Without a pace nothing is said to nobody, and the clock stops while a bus is dead.
        is_heard = any(line.adapter.is_open for line in lines)
        return is_heard and all(now >= line.dead_until for line in lines)

    def _is_due(self, tick: Tick, now: float) -> bool:
        if self._rate <= 0.0:
            return True
        if self._start is None:
            self._start = now, tick.t
        wall, t = self._start
        return now >= wall + (tick.t - t) / self._rate

    def _send(self, bus: str, frames: Sequence[Frame]) -> None:
        line = self._lines[bus]
        if time.monotonic() >= line.dead_until:
            line.adapter.send(line.injector.stamped(frames))

    def _say(self, frame: Frame) -> None:
        for bus in self._lines:
            self._send(bus, [frame])

    def _pass_on(self, line: _Line, items: Sequence[Frame | Outage]) -> None:
        passing = [item for item in items if isinstance(item, Frame)]
        if len(passing) == len(items):
            line.adapter.send(passing)
            return
        for item in items:
            if isinstance(item, Outage):
                self._fail(line, item)
            else:
                line.adapter.send([item])

    # Outages

    def _fail(self, line: _Line, outage: Outage) -> None:
        if outage.kind == "bus_off":
            line.adapter.send([Frame(BUS_OFF, bytes(8), self._t, ERROR)])
            line.adapter.note_bus_off()
        elif outage.kind == "disconnect":
            self._drain(line.adapter)
            line.adapter.disconnect()
            line.is_unplugged = True
        line.dead_until = time.monotonic() + outage.duration

    def _drain(self, adapter: Adapter) -> None:
        """Let a host that listens take what was sent before the plug is pulled."""
        now = time.monotonic()
        end, quiet_since = now + DRAIN, now
        while adapter.is_open and now < end and now - quiet_since < QUIET:
            adapter.flush()
            time.sleep(VIRTUAL_PATIENCE)
            now = time.monotonic()
            if adapter.backlog or getattr(adapter, "unread", 0):
                quiet_since = now

    def _revive(self, now: float) -> None:
        for line in self._lines.values():
            if line.is_unplugged and now >= line.dead_until:
                line.adapter.connect()
                line.is_unplugged = False

    # Wait

    def _wait(self) -> None:
        reading, writing = list[int](), list[int]()
        patience = PATIENCE
        for line in self._lines.values():
            readable, writable = line.adapter.fds
            reading += readable
            writing += writable
            if not readable and not line.is_unplugged:
                patience = VIRTUAL_PATIENCE
        patience = min(patience, self._until_due())
        if reading or writing:
            select.select(reading, writing, [], patience)
        elif patience > 0.0:
            time.sleep(patience)

    def _until_due(self) -> float:
        """Return how long nothing is to be said [s]."""
        now = time.monotonic()
        if not self._may_speak(now):
            waits = [line.dead_until - now for line in self._lines.values()]
            return min([w for w in waits if w > 0.0], default=PATIENCE)
        if self._next is None:
            return 0.0 if self._robot.has_more else PATIENCE
        if self._start is None or self._rate <= 0.0:
            return 0.0
        wall, t = self._start
        return max(0.0, wall + (self._next.t - t) / self._rate - now)
