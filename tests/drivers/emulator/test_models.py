# SPDX-License-Identifier: Apache-2.0
"""Devices answer what their manuals say, byte for byte: scripts of (sent, received) frames."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from comcal.measure.source import Block
from comcal_drivers.emulator.device import EmulatedDevice
from comcal_drivers.emulator.frame import REMOTE, Frame
from comcal_drivers.emulator.meters import Hardware, WrenchMeter
from comcal_drivers.emulator.models.ati_netcanoem import AtiNetcanoem
from comcal_drivers.emulator.registry import emulate

Script = Sequence[tuple[tuple[int, str], list[tuple[int, str]]]]


def play(device: EmulatedDevice, script: Script) -> None:
    """Send each frame of a script; require exactly the answers in it."""
    for (identifier, data), answers in script:
        got = device.hear(Frame(identifier, bytes.fromhex(data)))
        assert [(f.id, f.data.hex(" ")) for f in got] == [
            (i, bytes.fromhex(d).hex(" ")) for i, d in answers
        ], f"answers to {identifier:X}#{data}"


def loaded(device: EmulatedDevice, wrench: Sequence[float], n: int = 3) -> list[list[Frame]]:
    """Let a device measure one wrench, and keep it as its newest sample."""
    block = Block(np.arange(n) / 100.0, np.zeros((n, 14)), {"l_foot": np.tile(wrench, (n, 1))})
    samples = device.stream(block, 0, 0).samples
    device.newest = tuple(samples[-1])
    return samples


def sensor(biped: Any, name: str, *, started: bool = False, **settings: Any) -> Any:
    return emulate(biped.sensor(name, **settings), biped.robot, started=started)


def test_netcanoem_answers_its_opcodes(biped: Any) -> None:
    """Units, counts and the order of the matrix as in the manual 9610-05-1030-04."""
    play(
        sensor(biped, "ati_netcanoem", ids={"base": 0x7F}),
        [
            ((0x7F6, "00"), [(0x7F6, "00")]),
            ((0x7F7, ""), [(0x7F7, "00 0F 42 40 00 0F 42 40")]),  # both 1 000 000
            ((0x7F8, ""), [(0x7F8, "02 03")]),  # N, N m
            ((0x7F5, ""), [(0x7F5, "46 54 31 32 33 34 35 00")]),
            ((0x7F9, "02"), [(0x7F9, "00 B1")]),
            ((0x7F9, "05"), [(0x7F9, "80 09")]),
            ((0x7FF, ""), [(0x7FF, "01 04 00 0C")]),
            ((0x7F2, "06"), []),  # there are six rows
            ((0x7F7, "00"), []),
            ((0x206, "00"), []),  # another base
        ],
    )


def test_netcanoem_hands_out_its_matrix_as_big_endian_floats(biped: Any) -> None:
    matrix = np.arange(1.0, 37.0).reshape(6, 6)
    config = biped.sensor("ati_netcanoem")
    device = AtiNetcanoem(config, WrenchMeter(config, Hardware(matrix)))
    got = device.hear(Frame(0x202, b"\x02"))
    assert [f.id for f in got] == [0x202, 0x203, 0x204]
    assert struct.unpack(">6f", b"".join(f.data for f in got)) == tuple(matrix[2])


def test_netcanoem_gages_are_interleaved_after_the_status(biped: Any) -> None:
    matrix = np.eye(6) * 1000.0
    config = biped.sensor("ati_netcanoem")
    device = AtiNetcanoem(config, WrenchMeter(config, Hardware(matrix, None, 1000.0, 1000.0)))
    loaded(device, [1.0, 2.0, 3.0, 4.0, 5.0, -6.0])
    even, odd = device.hear(Frame(0x200))
    assert (even.id, struct.unpack(">Hhhh", even.data)) == (0x200, (0, 1, 3, 5))
    assert (odd.id, struct.unpack(">hhh", odd.data)) == (0x201, (2, 4, -6))


def test_netcanoem_is_back_in_slot_0_after_a_reset(biped: Any) -> None:
    device = sensor(biped, "ati_netcanoem")

    def gages() -> tuple[int, ...]:
        loaded(device, [0.0, 0.0, 300.0, 0.0, 0.0, 0.0])
        return struct.unpack(">Hhhh", device.hear(Frame(0x200))[0].data)

    in_slot_0, row_0 = gages(), device.hear(Frame(0x202, b"\x02"))[0].data
    play(device, [((0x206, "01"), [(0x206, "01")])])
    in_slot_1, row_1 = gages(), device.hear(Frame(0x202, b"\x02"))[0].data
    assert in_slot_1[1] == pytest.approx(2 * in_slot_0[1], abs=1)
    assert row_1 != row_0
    play(device, [((0x206, "09"), [(0x206, "09")])])
    assert gages()[0] == 1 << 6  # bad active calibration
    play(device, [((0x20C, ""), [])])
    assert gages() == in_slot_0
    assert device.hear(Frame(0x202, b"\x02"))[0].data == row_0


@pytest.mark.parametrize(
    ("name", "request_", "ids", "size"),
    [
        ("ati_netbox_long", b"\x01", [0x1B1, 0x1B2, 0x1B3, 0x1B4], 8),
        ("ati_netbox_short", b"\x02", [0x1B5, 0x1B6], 8),
    ],
)
def test_netbox_answers_each_request_once_and_tares(
    biped: Any, name: str, request_: bytes, ids: list[int], size: int
) -> None:
    counts = {"counts_per_force": 100.0, "counts_per_torque": 100.0}
    device = sensor(biped, name, **counts)
    assert device.hear(Frame(0x1B0, request_)) == []  # nothing was measured yet
    loaded(device, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    got = device.hear(Frame(0x1B0, request_))
    assert [f.id for f in got] == ids
    assert {len(f.data) for f in got} == {size}
    if name == "ati_netbox_long":
        assert struct.unpack("<ii", got[0].data) == (100, 400)  # Fx, Tx: little-endian
    else:
        assert struct.unpack("<hhhh", got[0].data) == (100, 400, 200, 500)
    assert device.hear(Frame(0x1B0, b"\x04")) == []
    loaded(device, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert device.hear(Frame(0x1B0, request_))[0].data == bytes(8)


def test_strain_tells_full_scales_and_streams_when_told(biped: Any) -> None:
    device = sensor(biped, "iit_strain", ids={"board": 3})
    assert not device.streams
    play(
        device,
        [
            ((0x203, "18 00"), [(0x230, "18 00 05 DC")]),  # 1500 N, big-endian
            ((0x203, "18 02"), [(0x230, "18 02 07 D0")]),  # 2000 N
            ((0x203, "18 05"), [(0x230, "18 05 00 19")]),  # 25 N m
            ((0x203, "18 06"), []),
            ((0x203, "1A"), [(0x230, "1A 45 4D 55 30 30 30 31")]),
            ((0x201, "18 00"), []),  # another board
            ((0x203, "08 05"), []),
            ((0x203, "07 00"), []),
        ],
    )
    assert device.streams
    assert device.period_ms == 5
    samples = loaded(device, [750.0, -750.0, 0.0, 0.0, 17.5, 0.0])
    force, torque = samples[0]
    assert (force.id, torque.id) == (0x33A, 0x33B)
    assert struct.unpack("<3H", force.data) == (0xC000, 0x4000, 0x8000)
    assert struct.unpack("<3H", torque.data) == (0x8000, 0xC000, 0x8000)
    play(device, [((0x203, "07 01"), [])])
    assert not device.streams


def test_strain_says_with_a_seventh_byte_that_it_is_at_its_limit(biped: Any) -> None:
    device = sensor(biped, "iit_strain", started=True)
    force, torque = loaded(device, [0.0, -1e6, 0.0, 0.0, 0.0, 0.0])[0]
    assert len(force.data) == 7
    assert struct.unpack("<3H", force.data[:6]) == (0x8000, 0, 0x8000)
    assert force.data[6] == 0b0001_0001  # something here; the second channel, low
    assert len(torque.data) == 6


def test_strain_takes_a_tare_and_forgets_it(biped: Any) -> None:
    device = sensor(biped, "iit_strain", started=True)
    before = loaded(device, [100.0, 0.0, 0.0, 0.0, 0.0, 0.0])[0][0].data
    play(device, [((0x201, "15 01"), [])])
    assert loaded(device, [100.0, 0.0, 0.0, 0.0, 0.0, 0.0])[0][0].data == b"\x00\x80" * 3
    play(device, [((0x201, "15 00"), [])])
    assert loaded(device, [100.0, 0.0, 0.0, 0.0, 0.0, 0.0])[0][0].data == before


def test_strain_sends_temperatures_when_told(biped: Any) -> None:
    device = sensor(biped, "iit_strain", started=True)
    t = np.arange(250) / 100.0
    block = Block(
        t, np.zeros((250, 14)), {"l_foot": np.zeros((250, 6))}, temperatures={"l_foot": t + 30.0}
    )
    assert not any(device.stream(block, 0, 0).beside)
    play(device, [((0x201, "39 01"), []), ((0x201, "3A 01"), [])])
    beside = device.stream(block, 0, 0).beside
    rows = [row for row, frames in enumerate(beside) if frames]
    assert rows == [0, 100, 200]
    assert beside[100][0].id == 0x31E
    assert struct.unpack("<Bhh", beside[100][0].data) == (1, 310, 0)  # 31 deg C


def test_jr3_acknowledges_and_starts_both_ways(biped: Any) -> None:
    device = sensor(biped, "jr3_uc3m", ids={"id": 5})
    assert [(f.id, f.data) for f in device.boot()] == [(0x705, b"")]
    play(
        device,
        [
            ((0x405, ""), [(0x105, "00")]),  # ready
            ((0x485, ""), [(0x105, "00 58 02 58 02 B0 04")]),  # 600, 600, 1200 N
            ((0x505, ""), [(0x105, "00 58 02 58 02 58 02")]),  # 600 tenths of a newton-metre
            ((0x401, ""), []),  # another board
            ((0x385, "01 04"), [(0x105, "00")]),
        ],
    )
    assert not device.streams
    play(device, [((0x205, "C8 00 10 27 00 00"), [(0x105, "00")])])
    assert device.streams
    play(device, [((0x285, ""), [(0x105, "00")]), ((0x185, "C8 00"), [(0x105, "00")])])
    assert not device.streams
    force, moment = loaded(device, [300.0, 0.0, 600.0, 0.0, 30.0, 0.0])[2]
    assert (force.id, moment.id) == (0x605, 0x685)
    assert struct.unpack("<hhhH", force.data) == (-8192, 0, 8192, 2)  # x is turned round
    assert struct.unpack("<hhhH", moment.data) == (0, 8192, 0, 2)
    assert [f.id for f in device.hear(Frame(0x080))] == [0x605, 0x685]


def test_jr3_zeroes_its_offsets(biped: Any) -> None:
    device = sensor(biped, "jr3_uc3m", started=True)
    loaded(device, [10.0, 20.0, 30.0, 1.0, 2.0, 3.0])
    play(device, [((0x301, ""), [(0x101, "00")])])
    force, moment = loaded(device, [10.0, 20.0, 30.0, 1.0, 2.0, 3.0])[0]
    assert force.data[:6] == moment.data[:6] == bytes(6)


def test_sunrise_starts_and_stops_and_sends_floats(biped: Any) -> None:
    device = sensor(biped, "sunrise_m8123")
    play(device, [((0x80, "02"), [])])
    assert device.streams
    sample = loaded(device, [1.5, -2.0, 3.0, 0.25, 0.5, -1.0])[0]
    assert [f.id for f in sample] == [0x291, 0x292, 0x293]
    assert struct.unpack("<6f", b"".join(f.data for f in sample)) == (1.5, -2, 3, 0.25, 0.5, -1)
    play(device, [((0x80, ""), []), ((0x80, "00"), [])])
    assert not device.streams


def test_rft_splits_tx_over_its_frames_and_knows_its_commands(biped: Any) -> None:
    device = sensor(biped, "robotous_rft")
    play(
        device,
        [
            ((0x64, "0F 05 00 00 00 00 00 00"), [(1, "0F 01 00" + "00" * 5), (2, "00" * 8)]),
            ((0x64, "10 00 00 00 00 00 00 00"), [(1, "10 05" + "00" * 6), (2, "00" * 8)]),
            ((0x64, "02 00 00 00 00 00 00 00"),
             [(1, "02 45 4D 55 30 30 30 30"), (2, "31" + "00" * 7)]),
            ((0x64, "0B"), []),  # commands have eight bytes
        ],
    )  # fmt: skip
    assert not device.streams
    play(device, [((0x64, "0B 00 00 00 00 00 00 00"), [])])
    assert device.streams
    play(device, [((0x64, "10 00 00 00 00 00 00 00"), [])])  # not while it streams
    first, second = loaded(device, [20.0, 0.0, -20.0, 0.6, 0.0, 0.0])[0]
    assert (first.id, first.data.hex()) == (1, "0b03e80000fc1804")  # tx = 0x04B0: high byte
    assert (second.id, second.data.hex()) == (2, "b000000000000000")  # and low byte
    play(device, [((0x64, "11 01 00 00 00 00 00 00"), [])])
    assert loaded(device, [20.0, 0.0, -20.0, 0.6, 0.0, 0.0])[0][0].data[1:] == bytes(7)
    play(device, [((0x64, "0C 00 00 00 00 00 00 00"), [])])
    assert not device.streams


def test_rft_says_which_axis_is_overloaded(biped: Any) -> None:
    device = sensor(biped, "robotous_rft", started=True)
    _, second = loaded(device, [1e6, 0.0, 0.0, 0.0, 0.0, -1e6])[0]
    assert second.data[5] == 0b0010_0001  # fx is bit 5, tz bit 0


def test_optoforce_packets_bear_their_checksum_and_obey_configurations(biped: Any) -> None:
    device = sensor(biped, "optoforce", scale=np.array([0.1] * 3))
    assert device.streams
    sample = loaded(device, [1.0, 0.0, -1.0, 0.0, 0.0, 0.0])[0]
    packet = b"".join(f.data for f in sample)
    assert {f.id for f in sample} == {0x100}
    assert len(packet) == 16
    assert packet[:4].hex() == "aa07080a"
    assert struct.unpack(">hhh", packet[8:14]) == (10, 0, -10)
    assert struct.unpack(">H", packet[14:])[0] == sum(packet[:14])
    zero = bytes([0xAA, 0, 0x32, 3, 0, 4, 255])
    zero += struct.pack(">H", sum(zero)) + bytes(7)
    wrong = zero[:7] + b"\0\0" + zero[9:]
    for packet in (wrong, zero):
        for piece in (packet[:8], packet[8:]):
            assert device.hear(Frame(0x101, piece)) == []
    assert device.rejected == 1
    assert not device.streams  # speed 0
    after = b"".join(f.data for f in loaded(device, [1.0, 0.0, -1.0, 0.0, 0.0, 0.0])[0])
    assert after[8:14] == bytes(6)


def test_odrive_answers_remote_requests(biped: Any) -> None:
    device = emulate(biped.drive("odrive_cansimple", ids={"node": 3}), biped.robot, started=True)
    block = Block(np.arange(3) / 100.0, np.full((3, 14), 0.1), {})
    device.newest = tuple(device.stream(block, 0, 0).samples[-1])
    assert [f.id for f in device.newest] == [3 << 5 | 0x09, 3 << 5 | 0x14]
    got = device.hear(Frame(3 << 5 | 0x14, bytes(8), kind=REMOTE))
    assert got == [device.newest[1]]
    assert device.hear(Frame(3 << 5 | 0x14, bytes(8))) == []


def test_vesc_positions_stay_within_a_turn(biped: Any) -> None:
    device = emulate(biped.drive("vesc_status"), biped.robot, started=True)
    block = Block(np.arange(2) / 100.0, np.full((2, 14), -0.1), {})
    status = device.stream(block, 0, 0).samples[0][1]
    assert struct.unpack(">hhhh", status.data)[3] / 50 == pytest.approx(360 - 5.7296, abs=0.02)
