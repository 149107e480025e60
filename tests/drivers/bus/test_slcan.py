# SPDX-License-Identifier: Apache-2.0
"""The bus behind a serial line, over a pseudo-terminal."""

from __future__ import annotations

import threading
import time

import can
import pytest

from comcal.errors import HardwareError
from comcal_drivers.bus import slcan
from comcal_drivers.bus.batch_bus import receive
from comcal_drivers.bus.error_frames import is_gap
from comcal_drivers.bus.open import open_bus
from comcal_drivers.devices.configuration import BusConfig


@pytest.fixture
def bus(serial_bus):
    opened = open_bus(serial_bus)
    yield opened
    opened.shutdown()


def test_opening_closes_the_channel_sets_the_bit_rate_and_opens_it(adapter, bus):
    assert adapter.heard.startswith(b"C\rS8\rO\r")


def test_shutdown_closes_the_channel(adapter, bus, until):
    bus.shutdown()
    until(lambda: adapter.heard.endswith(b"C\r"))


def test_a_bell_to_the_bit_rate_is_an_error(adapter, serial_bus):
    adapter.answers[b"S8"] = b"\a"
    with pytest.raises(HardwareError, match=r"refuses the command S8.*bit rate"):
        open_bus(serial_bus)


def test_a_bell_to_closing_is_none(adapter, serial_bus):
    adapter.answers[b"C"] = b"\a"
    open_bus(serial_bus).shutdown()


def test_an_adapter_that_never_answers_is_opened_all_the_same(adapter, serial_bus, monkeypatch):
    monkeypatch.setattr(slcan, "BOOT_TIME", 0.2)
    monkeypatch.setattr(slcan, "ANSWER_TIME", 0.05)
    adapter.answers = dict.fromkeys((b"C", b"S8", b"O"), b"")
    began = time.monotonic()
    open_bus(serial_bus).shutdown()
    assert time.monotonic() - began < 2.0
    assert adapter.heard.endswith((b"S8\rO\r", b"S8\rO\rC\r"))


def test_what_was_sent_before_opening_is_forgotten_with_the_line_that_was_cut(
    adapter, serial_bus, numbers
):
    adapter.say(b"88001122\rt10380700000000000000\rt1038")
    bus = open_bus(serial_bus)
    adapter.number(1, 3)
    assert numbers(receive(bus, 1.0)) == [1, 2]
    assert bus.garbage == 0
    bus.shutdown()


def test_frames_that_come_with_the_answer_to_opening_are_not_lost(adapter, serial_bus):
    adapter.answers[b"O"] = b"\rt1231AA\rt1231BB\rt1231"
    bus = open_bus(serial_bus)
    adapter.say(b"CC\r")
    payloads = []
    while len(batch := bus.receive(0.5)):
        payloads += batch.data[:, 0].tolist()
    assert payloads == [0xAA, 0xBB, 0xCC]
    bus.shutdown()


def test_an_adapter_that_goes_on_sending_does_not_keep_the_program_from_starting(
    adapter, serial_bus
):
    """Its channel was left open, and it closes late or never."""
    stop = threading.Event()

    def send() -> None:
        k = 0
        while not stop.wait(0.001):
            adapter.number(k, k := k + 1)

    sender = threading.Thread(target=send)
    sender.start()
    began = time.monotonic()
    bus = open_bus(serial_bus)
    assert time.monotonic() - began < 5.0
    assert len(bus.receive(1.0))
    stop.set()
    sender.join(5.0)
    bus.shutdown()


def test_frames_come_in_order_with_the_time_of_this_computer(adapter, bus, numbers, until):
    began = time.time()
    adapter.number(0, 100)
    got = []
    until(lambda: got.extend(numbers(bus.receive(0.1))) or len(got) >= 100)
    assert got == list(range(100))
    adapter.number(100, 101)
    assert began <= bus.receive(1.0).t[0] <= time.time()


def test_it_is_a_bus_of_python_can(adapter, bus):
    adapter.say(b"t12320102\rT000001231FF\r")
    assert isinstance(bus, can.BusABC)
    first, second = bus.recv(1.0), bus.recv(1.0)
    assert (first.arbitration_id, bytes(first.data), first.is_extended_id) == (
        0x123,
        b"\x01\x02",
        False,
    )
    assert (second.arbitration_id, bytes(second.data), second.is_extended_id) == (
        0x123,
        b"\xff",
        True,
    )
    assert bus.recv(0.01) is None


def test_sent_messages_reach_the_adapter(adapter, bus, until):
    bus.send(can.Message(arbitration_id=0x20, is_extended_id=False, data=b"\x01\xab"))
    until(lambda: b"t020201AB\r" in adapter.heard)


def test_an_adapter_that_ran_over_is_asked_and_marks_the_gap(adapter, bus, monkeypatch):
    monkeypatch.setattr(slcan, "FLAGS_PERIOD", 0.05)
    assert len(bus.receive(0.2)) == 0, "nothing went wrong"
    adapter.answers[b"F"] = b"F08\r"
    deadline = time.monotonic() + 5.0
    while not len(batch := bus.receive(0.1)):
        assert time.monotonic() < deadline
    assert is_gap(batch).all()


def test_an_adapter_that_does_not_know_the_question_is_not_asked_again(adapter, bus, monkeypatch):
    monkeypatch.setattr(slcan, "FLAGS_PERIOD", 0.02)
    adapter.answers[b"F"] = b"\a"
    for _ in range(20):
        assert len(bus.receive(0.02)) == 0
    asked = adapter.heard.count(b"F")
    assert 1 <= asked < 5
    for _ in range(10):
        bus.receive(0.02)
    assert adapter.heard.count(b"F") == asked
    assert bus.garbage == 0


def test_pulling_the_adapter_out_is_an_error_at_once(adapter, bus):
    adapter.unplug()
    with pytest.raises(can.CanOperationError, match="gone"):
        bus.receive(1.0)
    bus.shutdown()


def test_a_port_that_another_thread_is_closing_is_an_adapter_that_is_gone(bus, monkeypatch):
    """For a moment it has no file descriptor any more and still says that it is open."""
    monkeypatch.setattr(bus._port, "fileno", lambda: None)
    with pytest.raises(can.CanOperationError, match="gone"):
        bus.receive(0.0)


def test_a_second_program_cannot_take_the_same_adapter(bus, serial_bus):
    with pytest.raises(HardwareError, match="another program uses it"):
        open_bus(serial_bus)


def test_without_a_bit_rate_the_adapter_keeps_its_own(adapter):
    open_bus(BusConfig("can0", "slcan", str(adapter.link))).shutdown()
    assert adapter.heard.startswith(b"C\rO\r")


def test_listening_only_never_acknowledges(adapter):
    open_bus(
        BusConfig("can0", "slcan", str(adapter.link), 500_000, {"listen_only": True})
    ).shutdown()
    assert adapter.heard.startswith(b"C\rS6\rL\r")
