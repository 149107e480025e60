# SPDX-License-Identifier: Apache-2.0
"""Frames of drives, packed by hand from their public documentation, decoded by our files.

Not covered: calibration to rad and A, which has its own tests.
"""

from __future__ import annotations

import struct
from pathlib import Path

import can
import numpy as np
import pytest

from comcal_drivers.decode.table import decode
from comcal_drivers.devices.description import Device, load_device
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.frames.logs import read_log
from comcal_drivers.frames.messages import pack

DRIVES = ("cia402", "cia402_torque", "maxon_epos", "mit_ak", "odrive_cansimple", "vesc_status")
CANOPEN = ("cia402", "cia402_torque", "maxon_epos")


def decoded(device: Device, identifier: int, payload: bytes, *, extended: bool = False):
    """Decode one frame; return signal -> value."""
    message = can.Message(arbitration_id=identifier, data=payload, is_extended_id=extended)
    (found,) = [d for d in decode(bus_table(device), pack([message])).values() if len(d)]
    return {name: float(values[0]) for name, values in found.values.items()}


@pytest.mark.parametrize("name", DRIVES)
def test_every_name_in_a_drive_file_is_a_signal_of_its_parts(name: str):
    device = load_device(name)
    description = device.description
    table = bus_table(device)
    parts = [m for m in table.messages.values() if m.name in description.parts]
    assert [m.name for m in parts] == list(description.parts)
    signals = {s.name for m in parts for s in m.signals}
    used = {*description.values}
    drive = description.calibrate.drive
    assert drive is not None
    for quantity in (drive.position, drive.current, drive.torque):
        if quantity is not None:
            used.add(quantity.signal)
            assert quantity.signal in description.values
    if description.status is not None and description.status.signal is not None:
        used.add(description.status.signal)
    if description.select is not None:
        used.add(description.select.signal)
    assert used <= signals
    assert drive.position is not None
    assert drive.current is not None or drive.torque is not None


@pytest.mark.parametrize("node", [0, 3, 63])
def test_odrive_frames_as_in_its_can_protocol(node: int):
    # docs/can-protocol.rst: id = node << 5 | cmd; 0x09 and 0x14 carry two little-endian floats.
    device = load_device("odrive_cansimple", {"node": node})
    estimates = decoded(device, node << 5 | 0x09, struct.pack("<ff", -2.25, 10.5))
    assert estimates == {"position": -2.25, "velocity": 10.5}
    iq = decoded(device, node << 5 | 0x14, struct.pack("<ff", 1.0, -0.75))
    assert iq == {"iq_setpoint": 1.0, "iq_measured": -0.75}


def test_vesc_frames_as_in_its_can_documentation():
    # comm_can.md: id = command << 8 | VESC id, big-endian; status 9 and status 4 (16).
    device = load_device("vesc_status", {"node": 23})
    first = bytes.fromhex("FFFFFC18 00C7 FE0C")  # -1000 rpm, 19.9 A, -0.5
    assert decoded(device, 0x0917, first, extended=True) == {
        "erpm": -1000,
        "current": 199,
        "duty": -500,
    }
    fourth = bytes.fromhex("0177 00FA FFEC 2328")  # 37.5 degC, 25 degC, -2 A, 180 deg
    assert decoded(device, 0x1017, fourth, extended=True) == {
        "temperature_fet": 375,
        "temperature_motor": 250,
        "current_in": -20,
        "position": 9000,
    }
    drive = device.description.calibrate.drive
    assert drive is not None
    assert 9000 * drive.position.scale == pytest.approx(180.0)
    assert 199 * drive.current.scale == pytest.approx(19.9)


def test_a_vesc_frame_with_an_11_bit_identifier_is_another_message():
    device = load_device("vesc_status", {"node": 23})
    message = can.Message(arbitration_id=0x17, data=bytes(8), is_extended_id=False)
    assert not any(len(d) for d in decode(bus_table(device), pack([message])).values())


def mit_reply(motor: int, position: int, velocity: int, current: int, tail: bytes = b"") -> bytes:
    """Pack as the AK manual draws it: id, 16 bits, 12 bits, 12 bits, highest bits first."""
    bits = motor << 40 | position << 24 | velocity << 12 | current
    return bits.to_bytes(6, "big") + tail


@pytest.mark.parametrize("tail", [b"", bytes([35, 0])])
def test_ak_replies_of_six_and_of_eight_bytes(tail: bytes):
    device = load_device("mit_ak", {"motor": 5})
    assert decoded(device, 0x000, mit_reply(5, 0xABCD, 0x123, 0x89A, tail)) == {
        "motor": 5,
        "position": 0xABCD,
        "velocity": 0x123,
        "current": 0x89A,
    }


def test_the_ranges_of_the_ak_are_those_of_the_source():
    # value = raw * (high - low) / (2^bits - 1) + low; i_q = 0.59 * torque / (9 * 0.091).
    drive = load_device("mit_ak").description.calibrate.drive
    assert drive is not None
    position, current = drive.position.linear, drive.current.linear
    assert (position.low, position.high, position.bits) == (-12.5, 12.5, 16)
    assert current.bits == 12
    assert current.high == pytest.approx(18.0 * 0.59 / (9.0 * 0.091), abs=1e-5)
    assert current.low == -current.high


def test_a_motor_number_of_the_ak_does_not_move_its_identifier():
    assert load_device("mit_ak", {"motor": 9}).relocate(0) == 0
    assert load_device("mit_ak", {"motor": 9, "host": 0x10}).relocate(0) == 0x10


@pytest.mark.parametrize(
    ("name", "second"),
    [("cia402", "current"), ("cia402_torque", "torque"), ("maxon_epos", "current")],
)
def test_cia_402_frames_are_little_endian_and_follow_the_node(name: str, second: str):
    device = load_device(name, {"node": 17})
    payload = struct.pack("<ihH", -2_000_000_000, -32768, 0x1237)
    assert decoded(device, 0x180 + 17, payload) == {
        "position": -2_000_000_000,
        second: -32768,
        "statusword": 0x1237,
    }


def test_the_real_log_holds_the_samples_of_its_epos(shared_dir: Path):
    table = bus_table(load_device("maxon_epos", {"node": 1}))
    log = shared_dir / "data" / "ati_epos_canlog" / "sensor-log.txt"
    found = [decode(table, batch)[0x181] for batch in read_log(log)]
    current = np.concatenate([each.values["current"] for each in found])
    assert current.size == 1666
    assert (current.min(), current.max()) == (-219, 300)  # mA
    assert not any(each.bad.any() for each in found)


def test_the_current_of_an_epos_is_in_milliampere_that_of_others_per_mille():
    epos = load_device("maxon_epos").description.calibrate.drive
    other = load_device("cia402").description.calibrate.drive
    torque = load_device("cia402_torque").description.calibrate.drive
    assert epos is not None
    assert other is not None
    assert torque is not None
    assert (epos.current.scale, epos.current.per_mille_of) == (0.001, None)
    assert other.current.per_mille_of == "rated_current"
    assert torque.torque.per_mille_of == "rated_torque"


@pytest.mark.parametrize("name", CANOPEN)
def test_canopen_drives_reserve_nmt_and_sync(name: str):
    assert set(load_device(name).description.reserves) == {0x000, 0x080}


def test_the_status_word_in_operation_spoils_no_sample():
    for name in CANOPEN:
        status = load_device(name).description.status
        assert status is not None
        in_operation, faulty = 0x1637, 0x0218
        assert not any(in_operation >> bit & 1 for bit in status.bits)
        assert any(faulty >> bit & 1 for bit in status.bits)
