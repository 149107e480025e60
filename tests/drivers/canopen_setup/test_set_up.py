# SPDX-License-Identifier: Apache-2.0
"""What drives are asked before a recording, over a virtual bus with a drive on its own thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import can
import canopen
import pytest

from comcal.errors import HardwareError
from comcal_drivers.canopen_setup.eds import read_layout
from comcal_drivers.canopen_setup.facts import (
    DriveFacts,
    check_layout,
    read_facts,
    require_rated,
)
from comcal_drivers.canopen_setup.sdo import Drive, MissingObjectError, open_network
from comcal_drivers.canopen_setup.set_up import nmt_start
from comcal_drivers.source.requests import SYNC, Poller, Request

POSITION, CURRENT, TORQUE, STATUS = 0x60640020, 0x60780010, 0x60770010, 0x60410010
LAB = [("$NODEID+0x180", 1, [POSITION, CURRENT, STATUS])]

Start = Callable[[Path, int], canopen.LocalNode]


@pytest.fixture
def network(bus: can.BusABC, opened: ExitStack) -> canopen.Network:
    return opened.enter_context(open_network(bus, [1, 2]))


@pytest.fixture
def facts(
    write_eds: Callable[..., Path], start_drive: Start, network: canopen.Network
) -> DriveFacts:
    start_drive(write_eds(LAB), 1)
    return read_facts(Drive(network, 1, "knee"))


def received(bus: can.BusABC, wanted: int, seconds: float = 2.0) -> Iterator[can.Message]:
    deadline = time.monotonic() + seconds
    while wanted and time.monotonic() < deadline:
        message = bus.recv(0.1)
        if message is not None:
            wanted -= 1
            yield message


def test_a_drive_tells_who_it_is_and_what_it_is_rated_for(facts: DriveFacts):
    assert facts.identity.serial == 0x09007003
    assert facts.rated_current == pytest.approx(5.0)
    assert facts.rated_torque == pytest.approx(88.0)
    assert facts.as_mapping() == {
        "node": 1,
        "title": "",
        "vendor": 0xFB,
        "product": 0x62110000,
        "revision": 2,
        "serial": 0x09007003,
        "rated_current": pytest.approx(5.0),
        "rated_torque": pytest.approx(88.0),
        "tpdos": [
            {
                "number": 1,
                "id": 0x181,
                "transmission": 1,
                "mapping": [POSITION, CURRENT, STATUS],
            }
        ],
    }


def test_the_mapping_read_back_equals_that_of_the_file(
    write_eds: Callable[..., Path], facts: DriveFacts, network: canopen.Network
):
    check_layout(read_layout(write_eds(LAB), 1), facts.layout, Drive(network, 1, "knee"))


@pytest.mark.parametrize(
    ("pdos", "both"),
    [
        ([("0x181", 1, [POSITION, TORQUE, STATUS])], ("0x6064/32, 0x6078/16", "0x6077/16")),
        ([("0x182", 1, [POSITION, CURRENT, STATUS])], ("on 0x181", "on 0x182")),
        ([("0x181", 255, [POSITION, CURRENT, STATUS])], ("type 1,", "type 255")),
        ([*LAB, ("0x281", 1, [STATUS])], ("no such TPDO", "0x6041/16 on 0x281")),
    ],
)
def test_a_drive_that_contradicts_its_file_is_refused_naming_both(
    write_eds: Callable[..., Path],
    facts: DriveFacts,
    network: canopen.Network,
    pdos: list[tuple[str, int, list[int]]],
    both: tuple[str, str],
):
    expected = read_layout(write_eds(pdos, name="other.eds"), 1)
    with pytest.raises(HardwareError) as caught:
        check_layout(expected, facts.layout, Drive(network, 1, "knee"))
    text = str(caught.value)
    assert all(part in text for part in (*both, "knee (node 1)", "other.eds"))


def test_objects_that_a_drive_lacks_are_none_unless_they_are_needed(
    write_eds: Callable[..., Path], start_drive: Start, network: canopen.Network
):
    start_drive(write_eds(LAB, leave_out=[0x6075, 0x6076]), 2)
    facts = read_facts(Drive(network, 2, "ankle"))
    assert facts.rated_current is None
    with pytest.raises(HardwareError, match=r"ankle \(node 2\).*0x6076 is missing.*robot\.yaml"):
        require_rated(facts, "rated_torque")


def test_a_rated_value_of_zero_is_refused(
    write_eds: Callable[..., Path], start_drive: Start, network: canopen.Network
):
    local = start_drive(write_eds(LAB), 1)
    local.set_data(0x6075, 0, bytes(4))
    with pytest.raises(HardwareError, match="0x6075 is zero"):
        require_rated(read_facts(Drive(network, 1, "knee")), "rated_current")


def test_a_missing_drive_is_an_error_within_its_time(network: canopen.Network):
    began = time.monotonic()
    with pytest.raises(HardwareError, match=r"hip \(node 2\): the drive does not answer"):
        read_facts(Drive(network, 2, "hip", timeout=0.05))
    assert time.monotonic() - began < 1.0


def test_a_refusal_names_the_object(facts: DriveFacts, network: canopen.Network):
    drive = Drive(network, 1, "knee")
    with pytest.raises(MissingObjectError, match="0x2999"):
        drive.read(0x2999)
    with pytest.raises(HardwareError, match=r"write 1 to 0x6064.*length"):
        drive.write(0x6064, 1, 2)


def test_negative_values_are_read_and_written(facts: DriveFacts, network: canopen.Network):
    drive = Drive(network, 1, "knee")
    assert drive.read(0x6064, signed=True) == -5
    drive.write(0x6064, -70000, 4)
    assert drive.read(0x6064, signed=True) == -70000


def test_an_answer_to_a_write_that_nobody_awaited_confuses_nothing(
    facts: DriveFacts, network: canopen.Network
):
    drive = Drive(network, 1, "knee")
    for k in range(100):
        drive.send_write(0x6041, k, 2)
        assert drive.read(0x6075) == 5000
    assert drive.read(0x6041) == 99


def test_set_up_leaves_the_bus_open_and_unfiltered(
    write_eds: Callable[..., Path], start_drive: Start, bus: can.BusABC, channel: str
):
    start_drive(write_eds(LAB), 1)
    with open_network(bus, [1]) as network:
        Drive(network, 1).read(0x6075)
    with can.Bus(interface="virtual", channel=channel) as other:
        other.send(can.Message(arbitration_id=0x123, is_extended_id=False))
        assert [m.arbitration_id for m in received(bus, 1)] == [0x123]


def test_nodes_are_started_and_given_the_sync(
    write_eds: Callable[..., Path], start_drive: Start, bus: can.BusABC, channel: str
):
    local = start_drive(write_eds(LAB), 1)
    with can.Bus(interface="virtual", channel=channel) as listener:
        bus.send(nmt_start(1))
        poller = Poller(bus.send, [Request(0.01, SYNC)])
        frames = [(m.arbitration_id, bytes(m.data)) for m in received(listener, 6)]
        poller.close()
    assert frames == [(0x000, b"\x01\x01"), *[(0x080, b"")] * 5]
    assert poller.failed == 0
    assert local.nmt.state == "OPERATIONAL"
