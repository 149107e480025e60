# SPDX-License-Identifier: Apache-2.0
"""Bytes as the manuals and public sources have them, read through the shipped layouts."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from comcal_drivers.decode.table import decode
from comcal_drivers.devices.description import load_device
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.join.joiner import Joiner
from comcal_drivers.join.sample import Samples, chain_samples


def batch_of(*frames: tuple[int, bytes]) -> FrameBatch:
    data = np.zeros((len(frames), 8), np.uint8)
    for row, (_, payload) in enumerate(frames):
        data[row, : len(payload)] = list(payload)
    return FrameBatch(
        np.arange(len(frames)) * 1e-4,
        np.array([number for number, _ in frames], np.uint32),
        np.array([len(payload) for _, payload in frames], np.uint8),
        data,
        np.zeros(len(frames), np.uint8),
    )


def read(name: str, *frames: tuple[int, bytes], **ids: int) -> Samples:
    device = load_device(name, ids)
    table = bus_table(device)
    joiner = Joiner(device, table)
    batch = batch_of(*frames)
    pieces = [joiner.feed(decode(table, batch), batch, 0), joiner.finish()]
    return chain_samples(pieces, len(device.description.values))


def test_netcanoem_gages_are_interleaved_and_big_endian() -> None:
    """The first sample of the log of a real board."""
    samples = read(
        "ati_netcanoem",
        (0x7F0, b""),
        (0x7F0, bytes.fromhex("40000012FE3AE6A8")),
        (0x7F1, bytes.fromhex("04FAFA930143")),
        base=0x7F,
    )
    np.testing.assert_array_equal(samples.values, [[0x12, 0x4FA, -454, -1389, -6488, 0x143]])
    assert samples.status.tolist() == [0x4000]


def test_netbox_is_little_endian() -> None:
    """The manual's example: 0x56 0x02 is 0x0256."""
    samples = read(
        "ati_netbox_short",
        (0x1B0, b"\x02"),
        (0x1B5, bytes.fromhex("5602") + struct.pack("<hhh", 2, 3, 4)),
        (0x1B6, struct.pack("<hhHH", -5, 6, 0x8002, 77)),
    )
    np.testing.assert_array_equal(samples.values, [[0x256, 3, -5, 2, 4, 6]])
    assert (samples.status.tolist(), samples.counter.tolist()) == ([0x8002], [77])


def test_netbox_long_data_of_the_manual() -> None:
    """The manual's example: 0x0F 0xCF 0xDA 0xFD is -35991793."""
    samples = read(
        "ati_netbox_long",
        (0x1B0, b"\x01"),
        (0x1B1, bytes.fromhex("0FCFDAFD") + struct.pack("<i", 2)),
        (0x1B2, struct.pack("<ii", 3, 4)),
        (0x1B3, struct.pack("<ii", 5, 6)),
        (0x1B4, struct.pack("<II", 1 << 17, 4_000_000_000)),
    )
    np.testing.assert_array_equal(samples.values, [[-35991793, 3, 5, 2, 4, 6]])
    assert samples.status.tolist() == [1 << 17]
    assert samples.counter.tolist() == [4_000_000_000]


@pytest.mark.parametrize("board", [1, 13])
def test_strain_counts_from_the_middle(board: int) -> None:
    base = 0x300 | board << 4
    samples = read(
        "iit_strain",
        (base | 0xA, struct.pack("<HHH", 0x8000, 0, 0xFFFF)),
        (base | 0xB, struct.pack("<HHH", 0x8001, 0x7FFF, 0xC000)),
        board=board,
    )
    np.testing.assert_array_equal(samples.values, [[0, -0x8000, 0x7FFF, 1, -1, 0x4000]])


def test_jr3_halves_share_a_counter() -> None:
    samples = read(
        "jr3_uc3m",
        (0x682, struct.pack("<hhhH", 4, -5, 6, 65535)),
        (0x602, struct.pack("<hhhH", 1, -2, 3, 65535)),
        (0x602, struct.pack("<hhhH", 7, 7, 7, 0)),
        id=2,
    )
    np.testing.assert_array_equal(samples.values, [[1, -2, 3, 4, -5, 6]])
    assert samples.counter.tolist() == [65535]


def test_sunrise_sends_floats() -> None:
    wrench = [1.5, -2.25, 300.0, 0.125, -0.5, 8.0]
    frames = [(0x291 + k, struct.pack("<ff", *wrench[2 * k : 2 * k + 2])) for k in range(3)]
    np.testing.assert_array_equal(read("sunrise_m8123", *frames).values, [wrench])


def test_rft_torque_is_split_over_two_frames() -> None:
    raw = [100, -200, 300, -4660, 500, -600]
    whole = b"\x0b" + struct.pack(">6h", *raw) + bytes([0x20, 0, 0])
    samples = read("robotous_rft", (1, whole[:8]), (2, whole[8:]))
    np.testing.assert_array_equal(samples.values, [raw])
    assert samples.status.tolist() == [0x20]


def test_optoforce_packet_with_its_checksum() -> None:
    body = bytes.fromhex("AA07080A") + struct.pack(">HHhhh", 513, 0, -1, 2, -300)
    whole = body + struct.pack(">H", sum(body))
    samples = read("optoforce", (0x100, whole[:8]), (0x100, whole[8:]))
    np.testing.assert_array_equal(samples.values, [[-1, 2, -300]])
    assert samples.counter.tolist() == [513]


def test_motors_with_one_identifier_are_told_apart() -> None:
    """MIT protocol: all motors answer to the host; the first byte says which one it was."""
    device = load_device("mit_ak", {"host": 0, "motor": 3})
    table = bus_table(device)
    joiner = Joiner(device, table)
    batch = batch_of(*((0, bytes([motor, 0x80, 0, 0x7F, 0xF7, 0xFF])) for motor in (1, 3, 2, 3)))
    assert len(joiner.feed(decode(table, batch), batch, 0)) == 2
    assert joiner.counts.frames == 2
