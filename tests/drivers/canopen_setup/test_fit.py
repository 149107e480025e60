# SPDX-License-Identifier: Apache-2.0
"""Drives of robot.yaml: layouts from files, questions before the stream, identifiers that clash."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import can
import canopen
import pytest

from comcal.errors import ConfigError, HardwareError
from comcal_drivers.canopen_setup.conflicts import sync_conflict
from comcal_drivers.canopen_setup.fit import fit_joint
from comcal_drivers.canopen_setup.set_up import rated_values, set_up_drives
from comcal_drivers.decode.table import decode
from comcal_drivers.devices.configuration import (
    BusConfig,
    CanConfig,
    JointConfig,
    SensorConfig,
)
from comcal_drivers.devices.description import load_device
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.frames.messages import pack

POSITION, CURRENT, TORQUE, STATUS = 0x60640020, 0x60780010, 0x60770010, 0x60410010
LAB = [("$NODEID+0x180", 1, [POSITION, CURRENT, STATUS])]

Start = Callable[[Path, int], canopen.LocalNode]


def joint(device: str, node: int = 1, **more) -> JointConfig:
    return JointConfig("knee", "can0", load_device(device, {"node": node}), **more)


def config(sensors: Mapping[str, tuple[str, str, dict[str, int]]]) -> CanConfig:
    """A drive as node 1 on can0, and sensors: name -> (bus, device, ids)."""
    return CanConfig(
        {name: BusConfig(name, "virtual", name) for name in ("can0", "can1")},
        {
            name: SensorConfig(name, bus, load_device(device, ids))
            for name, (bus, device, ids) in sensors.items()
        },
        {"knee": joint("maxon_epos")},
        None,
        "knee",
    )


def test_a_drive_without_a_file_keeps_the_layout_it_comes_with(tmp_path: Path):
    knee = joint("maxon_epos")
    assert fit_joint(knee, tmp_path) is knee


@pytest.mark.parametrize("node", [1, 9])
def test_the_layout_of_a_file_replaces_that_of_the_device(
    write_eds: Callable[..., Path], tmp_path: Path, node: int
):
    eds = write_eds([("$NODEID+0x280", 1, [STATUS, CURRENT, POSITION])])
    device = fit_joint(joint("maxon_epos", node, eds=eds), tmp_path).device
    assert device.description.parts == ("TPDO1",)
    message = can.Message(
        arbitration_id=0x280 + node,
        data=struct.pack("<Hhi", 0x237, -44, 12345),
        is_extended_id=False,
    )
    (found,) = decode(bus_table(device), pack([message])).values()
    assert {n: v.tolist() for n, v in found.values.items()} == {
        "statusword": [0x237],
        "current": [-44],
        "position": [12345],
    }


def test_values_in_two_pdos_become_two_parts_of_one_sample(
    write_eds: Callable[..., Path], tmp_path: Path
):
    eds = write_eds([("0x181", 1, [POSITION]), ("0x281", 1, [TORQUE])])
    description = fit_joint(joint("cia402_torque", eds=eds), tmp_path).device.description
    assert (description.parts, description.join.rule) == (("TPDO1", "TPDO2"), "fifo")
    assert description.status is None  # the status word is not sent


def test_a_file_without_the_values_of_the_device_is_refused(
    write_eds: Callable[..., Path], tmp_path: Path
):
    with pytest.raises(ConfigError, match=r"carries 0x6077.*map it into a TPDO"):
        fit_joint(joint("cia402_torque", eds=write_eds(LAB)), tmp_path)
    with pytest.raises(ConfigError, match="both `eds` and `dcf`"):
        fit_joint(joint("cia402", eds=write_eds(LAB), dcf=write_eds(LAB)), tmp_path)
    with pytest.raises(ConfigError, match="odrive_cansimple is no CANopen drive"):
        fit_joint(joint("odrive_cansimple", eds=write_eds(LAB)), tmp_path)


@pytest.mark.parametrize("with_file", [True, False])
def test_a_drive_that_is_mapped_as_expected_is_accepted(
    write_eds: Callable[..., Path], start_drive: Start, bus: can.BusABC, with_file: bool
):
    eds = write_eds(LAB)
    start_drive(eds, 1)
    facts = set_up_drives(bus, [joint("cia402", eds=eds if with_file else None)])
    assert rated_values(facts["knee"]) == pytest.approx({"rated_current": 5, "rated_torque": 88})


def test_a_drive_that_is_mapped_otherwise_is_refused_naming_both(
    write_eds: Callable[..., Path], start_drive: Start, bus: can.BusABC
):
    start_drive(write_eds([("0x181", 1, [STATUS, POSITION, CURRENT])]), 1)
    with pytest.raises(HardwareError) as caught:
        set_up_drives(bus, [joint("maxon_epos")])
    for part in ("knee (node 1)", "maxon_epos has 0x6064 at bit 0", "0x6041/16, 0x6064/32"):
        assert part in str(caught.value)


def test_a_rated_value_that_robot_yaml_gives_is_not_needed_of_the_drive(
    write_eds: Callable[..., Path], start_drive: Start, bus: can.BusABC
):
    start_drive(write_eds(LAB, leave_out=[0x6075]), 1)
    with pytest.raises(HardwareError, match="rated current"):
        set_up_drives(bus, [joint("cia402")])
    facts = set_up_drives(bus, [joint("cia402", rated_current=4.0)])
    assert facts["knee"].rated_current is None


def test_drives_without_canopen_are_not_asked(bus: can.BusABC):
    assert set_up_drives(bus, [joint("odrive_cansimple")]) == {}


def test_the_start_command_of_a_sensor_must_not_be_the_sync():
    refused = sync_conflict(config({"l_foot": ("can0", "sunrise_m8123", {})}))
    assert isinstance(refused, ConfigError)
    for part in ("l_foot", "sunrise_m8123", "SYNC", "0x080", "bus can0", "two buses"):
        assert part in str(refused)
    assert sync_conflict(config({"l_foot": ("can1", "sunrise_m8123", {})})) is None


def test_the_frames_of_a_sensor_must_not_be_services_of_a_node():
    # JR3: op << 7 | id, among them 0x581 and 0x601, with which node 1 is asked by SDO.
    refused = sync_conflict(config({"l_foot": ("can0", "jr3_uc3m", {"id": 1})}))
    assert "to knee (node 1)" in str(refused)
    assert sync_conflict(config({"l_foot": ("can0", "jr3_uc3m", {"id": 2})})) is None


def test_the_frames_of_a_sensor_must_not_command_a_drive():
    # ATI NETCANOEM with its default base answers on 0x200 and 0x201: RPDO 1 of node 1.
    refused = sync_conflict(config({"l_foot": ("can0", "ati_netcanoem", {})}))
    assert "RPDO 1 to knee (node 1)" in str(refused)
    assert sync_conflict(config({"l_foot": ("can0", "ati_netcanoem", {"base": 0x7F})})) is None
