# SPDX-License-Identifier: Apache-2.0
"""What a device answers is taken for the answer to the question that was asked, and no other."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import can
import pytest

from comcal.errors import HardwareError
from comcal_drivers.devices.description import load_device, with_ids
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.messages import pack
from comcal_drivers.source import start
from comcal_drivers.source.start import command_device

ID = 0x70
SCALES = (600.0, 600.0, 1200.0, 60.0, 60.0, 60.0)
STREAMED = can.Message(arbitration_id=0x600 + ID, data=bytes(8), is_extended_id=False)


class Bus:
    """A JR3 board that streams already, and answers so many looks after it was asked."""

    def __init__(self, late: int, deaf: int = 0) -> None:
        self.late, self.deaf, self.looks = late, deaf, 0
        self.queue: list[tuple[int, can.Message]] = []

    def send(self, message: can.Message) -> None:
        message.is_rx = False
        # The reader's thread hands over what it had read before it hands over what was sent.
        self.queue.append((self.looks + 2, message))
        opcode = message.arbitration_id - ID
        scales = {0x480: SCALES[:3], 0x500: SCALES[3:]}.get(opcode, ())
        data = b"\0" + struct.pack(f"<{len(scales)}H", *map(int, scales))
        answer = can.Message(arbitration_id=0x100 + ID, data=data, is_extended_id=False)
        if self.deaf:
            self.deaf -= 1
        else:
            self.queue.append((self.looks + 2 + self.late, answer))

    def take(self, timeout: float) -> FrameBatch:
        self.looks += 1
        self.time += timeout
        due = [message for at, message in self.queue if at <= self.looks]
        self.queue = [each for each in self.queue if each[0] > self.looks]
        return pack([STREAMED, *due])

    time = 0.0


def ask(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(start, "time", SimpleNamespace(monotonic=lambda: bus.time))
    device = with_ids(load_device("jr3_uc3m"), {"id": ID})
    config: Any = SimpleNamespace(
        name="l_foot", device=device, settings=device.description.settings
    )
    return command_device(bus.send, bus.take, config, ("stop", "full_scale", "start"))


@pytest.mark.parametrize("late", [0, 1, 5, 20])
def test_a_board_that_streams_already_is_understood(
    late: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ask(Bus(late), monkeypatch) == {"full_scale": SCALES}


@pytest.mark.parametrize("late", [28, 30, 40])
def test_a_late_answer_is_not_taken_for_the_one_to_the_next_question(
    late: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ask(Bus(late), monkeypatch) == {"full_scale": SCALES}


def test_a_lost_question_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    assert ask(Bus(1, deaf=2), monkeypatch) == {"full_scale": SCALES}


def test_a_silent_device_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HardwareError, match=r"l_foot.*'stop'.*asked 3 times"):
        ask(Bus(1, deaf=99), monkeypatch)
