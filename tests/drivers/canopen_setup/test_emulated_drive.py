# SPDX-License-Identifier: Apache-2.0
"""Set-up against the drives of the emulator, whose SDO server was written apart from canopen's."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import can
import pytest

from comcal_drivers.canopen_setup.facts import DriveFacts
from comcal_drivers.canopen_setup.set_up import rated_values, set_up_drives
from comcal_drivers.devices.configuration import JointConfig
from comcal_drivers.devices.description import load_device
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.meters import DriveMeter
from comcal_drivers.emulator.models.canopen_drive import CanopenDrive


@pytest.fixture
def powered(channel: str) -> Iterator[list[CanopenDrive]]:
    """Emulated drives that hear and answer on the virtual bus; tests append to them."""
    drives: list[CanopenDrive] = []
    end = threading.Event()
    bus = can.Bus(interface="virtual", channel=channel)

    def run() -> None:
        while not end.is_set():
            message = bus.recv(0.01)
            if message is None:
                continue
            for drive in drives:
                for frame in drive.hear(Frame(message.arbitration_id, bytes(message.data))):
                    bus.send(
                        can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False)
                    )

    thread = threading.Thread(target=run)
    thread.start()
    yield drives
    end.set()
    thread.join(5.0)
    bus.shutdown()


def set_up(bus: can.BusABC, powered: list[CanopenDrive], device: str) -> DriveFacts:
    joint = JointConfig("knee", "can0", load_device(device, {"node": 7}), counts_per_turn=2048)
    powered.append(CanopenDrive(joint, DriveMeter(joint, 0, rated_current=5.0, rated_torque=0.25)))
    return set_up_drives(bus, [joint])["knee"]


@pytest.mark.parametrize("device", ["cia402", "cia402_torque"])
def test_the_emulated_drive_passes_as_its_device_file_says(
    bus: can.BusABC, powered: list[CanopenDrive], device: str
):
    facts = set_up(bus, powered, device)
    assert rated_values(facts) == pytest.approx({"rated_current": 5.0, "rated_torque": 0.25})
    assert facts.title == "emulated CiA 402 drive"  # longer than one frame: a segmented transfer
    assert facts.identity.serial == 1007


def test_the_emulated_epos_has_no_rated_values_and_needs_none(
    bus: can.BusABC, powered: list[CanopenDrive]
):
    facts = set_up(bus, powered, "maxon_epos")
    assert rated_values(facts) == {}
    assert facts.identity.vendor == 0xFB
    assert facts.layout.pdos[0].is_synchronous
