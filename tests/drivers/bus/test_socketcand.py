# SPDX-License-Identifier: Apache-2.0
"""The client of socketcand against a small daemon on the loopback."""

from __future__ import annotations

import time

import can
import pytest

from comcal.errors import HardwareError
from comcal_drivers.bus import socketcand
from comcal_drivers.bus.open import open_bus


@pytest.fixture
def bus(daemon, daemon_bus, until):
    opened = open_bus(daemon_bus)
    until(lambda: daemon.client is not None)
    yield opened
    opened.shutdown()


def test_frames_come_with_the_stamps_of_the_daemon(daemon, bus):
    daemon.say(b"< frame 123 1700000000.000123 0102 >< frame 00000123 1700000000.000124 FF >")
    batch = bus.receive(1.0)
    assert batch.t.tolist() == [1700000000.000123, 1700000000.000124]
    assert batch.data[:, 0].tolist() == [1, 255]


def test_it_is_a_bus_of_python_can(daemon, bus, until):
    daemon.say(b"< frame 123 1.5 0102 >")
    message = bus.recv(1.0)
    assert (message.arbitration_id, bytes(message.data), message.timestamp) == (
        0x123,
        b"\1\2",
        1.5,
    )
    bus.send(can.Message(arbitration_id=0x20, is_extended_id=False, data=b"\x01\xab"))
    until(lambda: daemon.heard == b"< send 020 2 01 AB >")


def test_the_end_of_the_connection_is_an_error_and_not_silence(daemon, bus):
    daemon.hang_up()
    with pytest.raises(can.CanOperationError, match="closed"):
        bus.receive(1.0)


def test_frames_that_come_with_the_last_answer_are_not_lost(daemon, daemon_bus):
    daemon.greeting = b"< hi >< ok >< ok >< frame 123 1.0 07 >"
    bus = open_bus(daemon_bus)
    try:
        assert bus.receive(1.0).data[0, 0] == 7
    finally:
        bus.shutdown()


def test_nobody_at_the_address_is_said_at_once(daemon, daemon_bus):
    daemon.close()
    began = time.monotonic()
    with pytest.raises(HardwareError, match=r"refused.*socketcand runs"):
        open_bus(daemon_bus)
    assert time.monotonic() - began < 2.0


@pytest.mark.parametrize(
    ("greeting", "words"),
    [(b"", "does not answer"), (b"SSH-2.0 >", "expected '< hi >'"), (b"\xff>", "expected")],
)
def test_who_is_no_daemon_is_refused_within_the_time(
    daemon, daemon_bus, monkeypatch, greeting, words
):
    monkeypatch.setattr(socketcand, "CONNECT_TIME", 0.2)
    daemon.greeting = greeting
    began = time.monotonic()
    with pytest.raises(HardwareError, match=words):
        open_bus(daemon_bus)
    assert time.monotonic() - began < 2.0
