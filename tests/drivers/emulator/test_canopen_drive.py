# SPDX-License-Identifier: Apache-2.0
"""The CiA 402 drive against the client of the library canopen."""

from __future__ import annotations

import struct
from typing import Any

import canopen
import numpy as np
import pytest
from canopen.sdo import SdoAbortedError

from comcal.measure.source import Block
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


def test_an_epos_has_no_rated_current_and_follows_sync(biped: Any) -> None:
    drive = emulate(biped.drive("maxon_epos", ids={"node": NODE}), biped.robot, started=True)
    assert isinstance(drive, CanopenDrive)
    assert drive.follows_sync
    assert (0x6075, 0) not in drive.server.objects
    assert [(f.id, f.data) for f in drive.boot()] == [(0x700 + NODE, b"\0")]
