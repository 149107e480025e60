# SPDX-License-Identifier: Apache-2.0
"""The CiA 402 drive against the client of the library canopen."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import canopen
import numpy as np
import pytest
from canopen.sdo import SdoAbortedError

from comcal.measure.source import Block
from comcal_drivers.canopen_setup.fit import fit_joint
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.models.canopen_drive import CanopenDrive
from comcal_drivers.emulator.registry import emulate

NODE = 11


class Wire(canopen.Network):
    """A network whose other end is an emulated drive, without a bus in between."""

    def __init__(self, drive: CanopenDrive) -> None:
        super().__init__()
        self.drive = drive

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        for answer in self.drive.hear(Frame(can_id, bytes(data))):
            self.notify(answer.id, bytearray(answer.data), 0.0)


@pytest.fixture
def drive(biped: Any) -> CanopenDrive:
    made = emulate(biped.drive("cia402", ids={"node": NODE}), biped.robot, started=False)
    assert isinstance(made, CanopenDrive)
    return made


@pytest.fixture
def remote(drive: CanopenDrive) -> Any:
    network = Wire(drive)
    node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())
    network.add_node(node)
    return node


def test_rated_values_identity_and_mapping_are_read_through_sdo(remote: Any) -> None:
    assert struct.unpack("<I", remote.sdo.upload(0x6075, 0)) == (10_000,)  # mA
    assert struct.unpack("<I", remote.sdo.upload(0x6076, 0)) == (1_000,)  # mN m
    assert remote.sdo.upload(0x1008, 0) == b"emulated CiA 402 drive"  # longer than a frame
    assert struct.unpack("<I", remote.sdo.upload(0x1018, 4)) == (1000 + NODE,)
    assert struct.unpack("<I", remote.sdo.upload(0x1800, 1)) == (0x180 + NODE,)
    mapping = [struct.unpack("<I", remote.sdo.upload(0x1A00, k))[0] for k in (1, 2, 3)]
    assert mapping == [0x60640020, 0x60780010, 0x60410010]


@pytest.mark.parametrize(
    ("index", "subindex", "code"), [(0x2000, 0, 0x06020000), (0x1018, 9, 0x06090011)]
)
def test_what_is_not_there_is_refused(remote: Any, index: int, subindex: int, code: int) -> None:
    with pytest.raises(SdoAbortedError) as caught:
        remote.sdo.upload(index, subindex)
    assert caught.value.code == code


def test_what_is_read_only_is_not_written(remote: Any) -> None:
    with pytest.raises(SdoAbortedError) as caught:
        remote.sdo.download(0x6075, 0, bytes(4))
    assert caught.value.code == 0x06010002


def test_it_sends_once_it_is_operational(drive: CanopenDrive, remote: Any) -> None:
    assert not drive.streams
    remote.nmt.state = "OPERATIONAL"
    assert drive.streams
    remote.nmt.state = "PRE-OPERATIONAL"
    assert not drive.streams


def test_a_synchronous_pdo_comes_on_sync(drive: CanopenDrive, remote: Any) -> None:
    remote.sdo.download(0x1800, 2, b"\x01")
    remote.nmt.state = "OPERATIONAL"
    block = Block(np.arange(3) / 100.0, np.full((3, 14), 0.5), {})
    drive.newest = tuple(drive.stream(block, 0, 0).samples[-1])
    assert not drive.streams
    assert drive.hear(Frame(0x080)) == list(drive.newest)
    counts = struct.unpack("<i", remote.sdo.upload(0x6064, 0))[0]
    assert counts == round(0.5 / (2 * np.pi) * 4096 * 50)
    assert struct.unpack_from("<i", drive.newest[0].data)[0] == counts


def write(remote: Any, index: int, kind: str, value: int) -> None:
    remote.sdo.download(index, 0, struct.pack(kind, value))


def status(remote: Any) -> int:
    return struct.unpack("<H", remote.sdo.upload(0x6041, 0))[0]


def test_the_state_machine_of_cia_402_leads_to_a_set_point(
    drive: CanopenDrive, remote: Any
) -> None:
    assert status(remote) & 0x4F == 0x40  # switch on disabled
    write(remote, 0x6060, "<b", 1)
    assert remote.sdo.upload(0x6061, 0) == b"\x01"
    for word, state in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)):
        write(remote, 0x6040, "<H", word)
        assert status(remote) & 0x6F == state
    write(remote, 0x607A, "<i", 4096 * 50 // 8)
    assert drive.target is None
    write(remote, 0x6040, "<H", 0x1F)
    assert drive.target == pytest.approx(np.pi / 4)
    assert status(remote) & (1 << 12)  # acknowledged
    assert not status(remote) & (1 << 10)  # not reached
    drive.arrive()
    assert status(remote) & (1 << 10)
    write(remote, 0x6040, "<H", 0x0F)
    assert not status(remote) & (1 << 12)
    write(remote, 0x6040, "<H", 0x0B)  # quick stop
    assert status(remote) & 0x6F == 0x07
    assert drive.target is None


def test_set_points_of_a_planned_pose_move_the_robot(biped: Any) -> None:
    names = biped.robot.tree.joint_names
    joints = ("l_hip_pitch", "l_knee")
    drives = [biped.drive("cia402", j, ids={"node": k}) for k, j in enumerate(joints, start=1)]
    here = biped.plan[0]
    other = np.array(here.q)
    columns = [names.index(joint) for joint in joints]
    other[columns] += 0.02, -0.03
    robot = biped.emulated(*drives, plan=(here, replace(here, pose=77, q=other)))
    robot.take(here.pose)
    for drive in robot.drives:
        assert robot.commanded is None
        remote = canopen.RemoteNode(drive.node, canopen.ObjectDictionary())
        Wire(drive).add_node(remote)
        write(remote, 0x6060, "<b", 1)
        for word in (0x06, 0x07, 0x0F):
            write(remote, 0x6040, "<H", word)
        write(remote, 0x607A, "<i", round(other[drive.column] / (2 * np.pi) * 4096 * 50))
        write(remote, 0x6040, "<H", 0x1F)
    assert robot.commanded == 77
    robot.take(77)
    assert robot.commanded is None
    assert all(drive.arrived for drive in robot.drives)


def eds() -> str:
    """A drive that sends current and a manufacturer's object before the position, on SYNC."""

    def variable(section: str, kind: int, value: str) -> str:
        return (
            f"[{section}]\nParameterName=x\nObjectType=0x7\nDataType={kind}\nAccessType=rw\n"
            f"DefaultValue={value}\nPDOMapping=1\n"
        )

    def record(index: int, values: list[tuple[int, str]]) -> str:
        head = f"[{index:04X}]\nParameterName=x\nObjectType=0x9\nSubNumber={len(values)}\n"
        return head + "".join(
            variable(f"{index:04X}sub{k}", kind, value) for k, (kind, value) in enumerate(values)
        )

    text = "[DeviceInfo]\nVendorName=Test\n" + variable("1017", 6, "0")
    for index, kind in ((0x2027, 3), (0x6041, 6), (0x6064, 4), (0x6078, 3)):
        text += variable(f"{index:04X}", kind, "0")
    text += record(0x1801, [(5, "2"), (7, "$NODEID+0x280"), (5, "1")])
    mapping = ("0x60780010", "0x20270010", "0x60640020")
    return text + record(0x1A01, [(5, "3"), *((7, value) for value in mapping)])


def test_a_drive_with_an_eds_sends_and_tells_what_the_eds_says(biped: Any, tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    path.write_text(eds())
    joint = fit_joint(biped.drive("cia402", ids={"node": NODE}, eds=path), tmp_path)
    drive = emulate(joint, biped.robot, started=True)
    assert isinstance(drive, CanopenDrive)
    assert drive.follows_sync
    q, i = np.full((2, 14), 0.5), np.full((2, 14), -2.0)
    frame = drive.stream(Block(np.arange(2) / 100.0, q, {}, currents=i), 0, 0).samples[0][0]
    assert frame.id == 0x280 + NODE
    counts = round(0.5 / (2 * np.pi) * 4096 * 50)
    assert struct.unpack("<hhi", frame.data) == (-200, 0, counts)  # per mille of 10 A
    node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())
    Wire(drive).add_node(node)
    told = [struct.unpack("<I", node.sdo.upload(0x1A01, k))[0] for k in (1, 2, 3)]
    assert told == [0x60780010, 0x20270010, 0x60640020]
    assert node.sdo.upload(0x1801, 2) == b"\x01"


def test_an_epos_has_no_rated_current_and_follows_sync(biped: Any) -> None:
    drive = emulate(biped.drive("maxon_epos", ids={"node": NODE}), biped.robot, started=True)
    assert isinstance(drive, CanopenDrive)
    assert drive.follows_sync
    assert (0x6075, 0) not in drive.server.objects
    assert [(f.id, f.data) for f in drive.boot()] == [(0x700 + NODE, b"\0")]
