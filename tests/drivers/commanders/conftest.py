# SPDX-License-Identifier: Apache-2.0
"""A CiA 402 drive in profile position mode that can be told to misbehave, on its own thread."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field

import can
import canopen
import pytest
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32

OBJECTS = {
    0x1000: (U32, 0x00020192),
    0x1017: (U16, 0),
    0x603F: (U16, 0),
    0x6040: (U16, 0),
    0x6041: (U16, 0),
    0x605A: (I16, 6),
    0x6060: (I8, 0),
    0x6061: (I8, 0),
    0x6064: (I32, 0),
    0x607A: (I32, 0),
    0x6081: (U32, 1000),
    0x6083: (U32, 1000),
    0x6084: (U32, 1000),
    0x608B: (I8, 0),
    0x608C: (U8, 0xA4),
}

NAMES = {
    "disabled": 0x0240,
    "ready": 0x0221,
    "on": 0x0223,
    "enabled": 0x0237,
    "quick stop": 0x0217,
    "fault": 0x0208,
}


@dataclass
class EmulatedDrive:
    """Written from the state machine of CiA 402; its motor runs at exactly the profile velocity.

    ``counts_per_second`` is what one unit of 0x6081 is. The rest are ways to fail.
    """

    local: canopen.LocalNode
    counts_per_second: float = 1.0
    state: str = "disabled"
    error_code: int = 0
    state_delay: float = 0.0
    stuck_in: str = ""
    fault_in: str = ""
    ignores_set_points: bool = False
    keeps_target: int | None = None
    fault_during_motion: float | None = None
    following_error_during_motion: float | None = None
    blocked: bool = False
    speed_factor: float = 1.0
    deaf_to_quick_stop: bool = False
    never_resets: bool = False
    words: list[int] = field(default_factory=list)
    stopped_at: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.lock = threading.RLock()
        self.acknowledged = False
        self.start_time = self.start_counts = self.target = 0.0
        self.counts, self.is_moving, self.velocity = 0.0, False, 0.0
        self.pending: tuple[float, str] | None = None
        self.local.add_read_callback(self._read)
        self.local.add_write_callback(self._write)

    def number(self, index: int, *, signed: bool = False) -> int:
        return int.from_bytes(self.local.get_data(index, 0), "little", signed=signed)

    def update(self) -> None:
        """Bring motor and state to the present."""
        with self.lock:
            now = time.monotonic()
            if self.pending is not None and now >= self.pending[0]:
                self.state, self.pending = self.pending[1], None
            if not self.is_moving:
                return
            since = now - self.start_time
            if self.fault_during_motion is not None and since > self.fault_during_motion:
                self._fail(0x8611)
                return
            way = self.target - self.start_counts
            gone = 0.0 if self.blocked else self.velocity * since
            if gone >= abs(way):
                self.counts, self.is_moving = self.target, False
            else:
                self.counts = self.start_counts + gone * (1 if way > 0 else -1)

    def statusword(self) -> int:
        self.update()
        word = NAMES[self.state]
        if self.acknowledged:
            word |= 1 << 12
        if not self.is_moving:
            word |= 1 << 10
        late = self.following_error_during_motion
        if self.is_moving and late is not None and time.monotonic() - self.start_time > late:
            word |= 1 << 13
        return word

    def _fail(self, code: int) -> None:
        self.state, self.is_moving, self.error_code, self.pending = "fault", False, code, None

    def _read(self, *, index: int, subindex: int, od: ODVariable):
        with self.lock:
            self.update()
            if index == 0x6041:
                return self.statusword()
            if index == 0x6064:
                return round(self.counts)
            if index == 0x6061:
                return self.number(0x6060, signed=True)
            if index == 0x603F:
                return self.error_code
            if index == 0x607A and self.keeps_target is not None:
                return self.keeps_target
        return None

    def _write(self, *, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        if index == 0x6040:
            with self.lock:
                self.update()
                self._control(int.from_bytes(data, "little"))

    def _control(self, word: int) -> None:
        before = self.words[-1] if self.words else 0
        self.words.append(word)
        rising = word & ~before
        if self.state == "fault":
            if rising & 0x80 and not self.never_resets:
                self._to("disabled")
                self.error_code = 0
            return
        if word & 0x06 == 0x02:
            if self.state == "enabled" and not self.deaf_to_quick_stop:
                self.stopped_at.append(time.monotonic())
                self.is_moving, self.acknowledged = False, False
                self.state = "quick stop"
            elif self.state in ("ready", "on"):
                self._to("disabled")
            return
        wanted = {0x06: "ready", 0x07: "on", 0x0F: "enabled"}.get(word & 0x0F)
        allowed = {
            "disabled": ("ready",),
            "ready": ("on",),
            "on": ("enabled", "ready"),
            "quick stop": ("enabled",),
        }.get(self.state, ())
        if wanted in allowed:
            self._to(wanted)
        if self.state != "enabled":
            return
        if not word & 0x10:
            self.acknowledged = False
        elif rising & 0x10 and not self.ignores_set_points:
            self.acknowledged = True
            self.start_time, self.start_counts = time.monotonic(), self.counts
            self.target = self.number(0x607A, signed=True)
            speed = self.number(0x6081) * self.counts_per_second
            self.velocity = speed * self.speed_factor
            self.is_moving = True

    def _to(self, state: str) -> None:
        if self.stuck_in == self.state:
            return
        if self.fault_in == state:
            self._fail(0x3220)
        elif self.state_delay:
            self.pending = (time.monotonic() + self.state_delay, state)
        else:
            self.state = state


def dictionary(leave_out: tuple[int, ...] = ()) -> canopen.ObjectDictionary:
    od = canopen.ObjectDictionary()
    for index, (kind, default) in OBJECTS.items():
        if index not in leave_out:
            variable = ODVariable(f"o{index:04X}", index)
            variable.data_type, variable.default = kind, default
            od.add_object(variable)
    identity = ODRecord("Identity", 0x1018)
    for sub, default in enumerate([4, 0xFB, 1, 2, 3]):
        variable = ODVariable(f"i{sub}", 0x1018, sub)
        variable.data_type, variable.default = (U32 if sub else U8), default
        identity.add_member(variable)
    od.add_object(identity)
    return od


@pytest.fixture
def channel() -> str:
    """A virtual bus of this test alone."""
    return f"test-{uuid.uuid4()}"


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def start_drive(channel: str, opened: ExitStack) -> Callable[..., EmulatedDrive]:
    """Start a drive on a network, hence a thread, of its own."""

    def start(node: int, *, leave_out: tuple[int, ...] = (), **behaviour) -> EmulatedDrive:
        network = canopen.Network(can.Bus(interface="virtual", channel=channel))
        network.NOTIFIER_CYCLE = 0.01
        network.connect()
        opened.callback(network.disconnect)
        local = network.create_node(node, dictionary(leave_out))
        local.nmt.state = "PRE-OPERATIONAL"
        return EmulatedDrive(local, **behaviour)

    return start
