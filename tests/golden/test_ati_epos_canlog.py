# SPDX-License-Identifier: Apache-2.0
"""A real log: ATI NETCANOEM force/torque sensor and Maxon EPOS drive on one bus, console candump.

The pairing is checked by a second implementation in this file, which shares nothing with the
drivers: it reads the text by itself and pairs by plain queues.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from comcal_drivers.calibrate.calibrated import Calibrated, status_notes
from comcal_drivers.calibrate.drive import drive_calibration
from comcal_drivers.calibrate.wrench import wrench_calibration
from comcal_drivers.decode.table import decode
from comcal_drivers.devices.commands import Listener
from comcal_drivers.devices.configuration import JointConfig, SensorConfig
from comcal_drivers.devices.description import Device, load_device
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.frames.batch import FrameBatch
from comcal_drivers.frames.logs import read_log
from comcal_drivers.join.joiner import Joiner
from comcal_drivers.join.sample import STATUS, Counts, Samples, chain_samples

FRAMES, WRENCHES, CURRENTS = 44_154, 808, 1666
LATE = 30
"""Second halves that come after the next request."""
WRONG_BY_LATEST = 26
"""Samples that pairing the second half with the latest first half gets wrong."""
Array = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def log(shared_dir: Path) -> Path:
    path = shared_dir / "data" / "ati_epos_canlog" / "sensor-log.txt"
    if not path.is_file():
        pytest.skip(f"the log {path} is not there: it has no licence to be copied with the tests")
    return path


@pytest.fixture(scope="module")
def batches(log: Path) -> list[FrameBatch]:
    return list(read_log(log, chunk=10_000))


@pytest.fixture(scope="module")
def sensor() -> Device:
    return load_device("ati_netcanoem", {"base": 0x7F})


def joined(device: Device, batches: Sequence[FrameBatch]) -> tuple[Samples, Counts]:
    table = bus_table(device)
    joiner, pieces, row = Joiner(device, table), list[Samples](), 0
    for batch in batches:
        pieces.append(joiner.feed(decode(table, batch), batch, row))
        row += len(batch)
    pieces.append(joiner.finish())
    return chain_samples(pieces, len(device.description.values)), joiner.counts


def gages_of(first: bytes, second: bytes) -> tuple[int, ...]:
    _, g0, g2, g4 = struct.unpack(">Hhhh", first)
    g1, g3, g5 = struct.unpack(">hhh", second)
    return g0, g1, g2, g3, g4, g5


def by_hand(log: Path) -> tuple[list[tuple[int, ...]], int, int]:
    """Gages of all samples by queues; how many halves came late; how many `latest` gets wrong."""
    firsts, seconds = deque[bytes](), deque[bytes]()
    samples, latest_pairs, latest = list[tuple[int, ...]](), list[tuple[int, ...]](), b""
    late, before = 0, ""
    for line in log.read_text().splitlines():
        _, number, length, *data = line.split()
        payload = bytes.fromhex("".join(data))
        if number == "7F0" and length == "[0]":
            late += before == "7F0[8]"
        elif number == "7F0":
            latest = payload
            firsts.append(payload)
        elif number == "7F1":
            seconds.append(payload)
            latest_pairs.append(gages_of(latest, payload))
        before = number + length if number in ("7F0", "7F1") else before
        while firsts and seconds:
            samples.append(gages_of(firsts.popleft(), seconds.popleft()))
    assert not firsts
    assert not seconds
    wrong = sum(a != b for a, b in zip(samples, latest_pairs, strict=True))
    return samples, late, wrong


def test_all_samples_are_found_and_none_is_mixed(
    log: Path, batches: list[FrameBatch], sensor: Device
) -> None:
    samples, counts = joined(sensor, batches)
    expected, late, wrong = by_hand(log)
    assert sum(map(len, batches)) == FRAMES
    assert len(samples) == len(expected) == WRENCHES
    np.testing.assert_array_equal(samples.values, np.array(expected, np.float64))
    assert (late, wrong) == (LATE, WRONG_BY_LATEST)  # the fault is there to be avoided
    assert counts.balanced(2)
    assert (counts.lost, counts.orphaned, counts.resyncs, counts.short) == (0, 0, 0, 0)
    assert counts.other == WRENCHES  # the requests
    assert np.isnan(samples.t).all()


def calibrated(
    device: Device, batches: Sequence[FrameBatch], ignore: tuple[int, ...]
) -> tuple[Calibrated, Counts, SensorConfig]:
    listener = Listener(device)
    for batch in batches:
        listener.see(batch)
    config = SensorConfig(
        "l_foot", "can1", device, ignore_status=ignore, ignore_where="robot.yaml:12"
    )
    samples, counts = joined(device, batches)
    result = wrench_calibration(config, listener.values).apply(samples)
    return result, counts + result.counts, config


def test_matrix_and_units_are_read_from_the_answers_in_the_log(
    batches: list[FrameBatch], sensor: Device
) -> None:
    listener = Listener(sensor)
    for batch in batches:
        listener.see(batch)
    told = listener.values
    assert set(told) == {
        "slot", "counts_per_force", "counts_per_torque", "force_unit", "torque_unit", "matrix",
    }  # fmt: skip
    assert told["counts_per_force"] == told["counts_per_torque"] == (1e6,)
    assert told["force_unit"] == told["torque_unit"] == (1.0,)  # N, N m
    first_row = struct.unpack(
        ">6f", bytes.fromhex("41A75FA64004D456C2F77DBA44E4EEB042C35EFEC4F66466")
    )
    assert len(told["matrix"]) == 36
    assert tuple(told["matrix"][:6]) == first_row


def test_wrenches_are_those_of_the_matrix_in_the_log(
    batches: list[FrameBatch], sensor: Device
) -> None:
    result, _, _ = calibrated(sensor, batches, (14,))
    samples, _ = joined(sensor, batches)
    listener = Listener(sensor)
    for batch in batches:
        listener.see(batch)
    M = np.array(listener.values["matrix"], np.float64).reshape(6, 6)
    np.testing.assert_allclose(result.values, samples.values @ M.T / 1e6, rtol=0, atol=1e-12)
    spread = np.ptp(result.values, axis=0)
    assert (spread > 0.01).all()
    assert (np.abs(result.values[:, :3]) < 200.0).all()
    assert (np.abs(result.values[:, 3:]) < 20.0).all()


def test_the_status_bit_that_is_always_set_is_ignored_by_configuration_and_reported(
    batches: list[FrameBatch], sensor: Device
) -> None:
    result, counts, config = calibrated(sensor, batches, (14,))
    assert not (result.flags & STATUS).any()
    assert counts.status == {14: WRENCHES}
    assert counts.ignored_status == {14: WRENCHES}
    assert status_notes(sensor.description, counts, config.ignore_where) == (
        "bit 14 (CAN bus error) set on 808 of 808 samples, ignored by robot.yaml:12",
    )


def test_without_configuration_every_sample_is_flagged(
    batches: list[FrameBatch], sensor: Device
) -> None:
    result, counts, _ = calibrated(sensor, batches, ())
    assert len(result) == WRENCHES
    assert ((result.flags & STATUS) != 0).all()
    assert counts.status == {14: WRENCHES}
    assert counts.ignored_status == {}
    assert status_notes(sensor.description, counts, "") == (
        "bit 14 (CAN bus error) set on 808 of 808 samples",
    )


def test_the_drive_sends_all_currents(log: Path, batches: list[FrameBatch]) -> None:
    device = load_device("maxon_epos", {"node": 1})
    samples, counts = joined(device, batches)
    config = JointConfig("l_knee", "can1", device, counts_per_turn=2048.0)
    current = drive_calibration(config, {}).apply(samples).values[:, 1]
    lines = (line.split() for line in log.read_text().splitlines())
    by_hand = [
        struct.unpack("<ihH", bytes.fromhex("".join(data)))[1] * 0.001
        for _, number, _, *data in lines
        if number == "181"
    ]
    assert len(samples) == counts.samples == CURRENTS
    np.testing.assert_array_equal(current, by_hand)
    assert current.min() == pytest.approx(-0.219, abs=1e-12)
    assert current.max() == pytest.approx(0.300, abs=1e-12)
