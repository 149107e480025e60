# SPDX-License-Identifier: Apache-2.0
"""The emulated robot: what it says depends on the pose alone."""

from __future__ import annotations

import struct
from itertools import islice
from typing import Any

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.measure.source import SourceRequest
from comcal.measure.still import StillCriterion
from comcal.measure.waiting import STEP
from comcal.workflow.sources import open_source
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.robot import (
    ARRIVED,
    FIRST_READ,
    REFUSED,
    EmulatedRobot,
    check_ids,
    command_of,
    state_frame,
)


def said(robot: EmulatedRobot, n: int = 200) -> list[tuple[int, bytes]]:
    """Return the next frames on can0."""
    ticks = (robot.tick() for _ in range(n))
    frames = [f for tick in ticks if tick is not None for f in tick.frames["can0"]]
    return [(f.id, f.data) for f in frames]


def test_frames_depend_on_the_pose_alone(biped: Any) -> None:
    devices = biped.sensor("jr3_uc3m"), biped.drive("odrive_cansimple")
    first, second, third = (p.pose for p in biped.plan[:3])
    one = biped.emulated(*devices)
    one.take(first)
    wanted = said(one)
    other = biped.emulated(*devices)
    for pose, samples in ((third, 7), (first, 50), (second, 130)):
        other.take(pose)
        said(other, samples)
    assert other.take(first).count == first * 7200
    assert said(other) == wanted
    assert other.take(second).state == ARRIVED
    assert said(other) != wanted


def test_another_seed_is_another_noise(biped: Any) -> None:
    robots = [biped.emulated(biped.sensor("jr3_uc3m"), seed=seed) for seed in (1, 2)]
    for robot in robots:
        robot.take(1)
    assert said(robots[0]) != said(robots[1])


def test_counters_go_on_from_the_number_of_the_pose(biped: Any) -> None:
    robot = biped.emulated(biped.sensor("jr3_uc3m"))
    move = robot.take(9)
    counters = [struct.unpack("<H", d[6:])[0] for i, d in said(robot, 900) if i == 0x601]
    assert move.count == 64800
    assert counters == [n % 65536 for n in range(64800, 65700)]


def test_readings_are_those_of_the_source_sample_by_sample(biped: Any) -> None:
    """Noise included: the recorder without a bus reads the same numbers."""
    robot = biped.emulated(biped.sensor("sunrise_m8123"), seed=3)
    robot.take(2)
    read = np.array(
        [struct.unpack("<6f", b"".join(d for _, d in said(robot, 1))) for _ in range(200)]
    )
    source = open_source("builtin", SourceRequest(biped.robot, 3))
    source.move_to(next(p for p in biped.plan if p.pose == 2))
    blocks = [source.read(max(StillCriterion().settle, StillCriterion().window))]
    blocks += [source.read(STEP) for _ in range(4)]
    wanted = np.vstack([block.wrenches["l_foot"] for block in blocks])[:200]
    np.testing.assert_array_equal(read, wanted.astype(np.float32))
    assert len(blocks[0].t) == round(FIRST_READ * 120)


def test_unknown_poses_are_refused_and_repetitions_are_not(biped: Any) -> None:
    robot = biped.emulated(biped.sensor("jr3_uc3m"))
    assert robot.take(700).state == REFUSED
    assert robot.tick() is None
    move = robot.take(700, planned_as=biped.plan[0].pose)
    assert (move.state, move.count) == (ARRIVED, 700 * 7200)


def test_a_tare_changes_what_is_said_from_the_next_sample_on(biped: Any) -> None:
    robot = biped.emulated(biped.sensor("jr3_uc3m"))
    robot.take(1)
    before = said(robot, 5)
    robot.hear("can0", Frame(0x301))
    after = said(robot, 5)
    loads = [struct.unpack("<3h", d[:6])[2] for i, d in (*before, *after) if i == 0x601]
    assert min(loads[:5]) > 1000
    assert max(map(abs, loads[5:])) < 100
    counters = [struct.unpack("<H", d[6:])[0] for i, d in (*before, *after) if i == 0x601]
    assert np.all(np.diff(counters) == 1)


def test_a_pose_ends_where_it_is_told_to(biped: Any) -> None:
    robot = biped.emulated(biped.sensor("jr3_uc3m"), length=0.5)
    robot.take(1)
    assert len(list(iter(robot.tick, None))) == 60
    assert not robot.has_more


def test_stamps_on_a_bus_increase(biped: Any) -> None:
    robot = biped.emulated(
        biped.sensor("ati_netcanoem"), biped.sensor("iit_strain", "r_foot"), biped.drive("cia402")
    )
    robot.take(1)
    ticks = list(islice(iter(robot.tick, None), 100))
    stamps = [f.t for tick in ticks for f in tick.frames["can0"]]
    assert np.all(np.diff(stamps) > 0.0)


def test_polled_devices_are_polled_by_somebody_else_only_if_started(biped: Any) -> None:
    devices = biped.sensor("ati_netcanoem"), biped.drive("maxon_epos")
    started = biped.emulated(*devices)
    started.take(1)
    tick = started.tick()
    assert tick is not None
    assert [(f.id, len(f.data)) for f in tick.frames["can0"]] == [
        (0x080, 0), (0x181, 8), (0x200, 0), (0x200, 8), (0x201, 6),
    ]  # fmt: skip
    silent = biped.emulated(*devices, started=False)
    silent.take(1)
    tick = silent.tick()
    assert tick is not None
    assert tick.frames["can0"] == []
    assert len(silent.hear("can0", Frame(0x200))) == 2


def test_without_a_pace_each_question_gets_the_next_sample(biped: Any) -> None:
    devices = biped.sensor("ati_netcanoem"), biped.sensor("sunrise_m8123", "r_foot")
    started = biped.emulated(*devices)
    started.take(1)
    wanted = [(i, d) for i, d in said(started, 20) if i in (0x200, 0x201) and d]
    asked = biped.emulated(*devices, started=False, is_paced=False)
    asked.take(1)
    got = list[tuple[int, bytes]]()
    for _ in range(20):
        assert asked.tick() is not None
        assert asked.tick() is None
        got += [(f.id, f.data) for f in asked.hear("can0", Frame(0x200))]
    assert got == wanted


def test_control_frames_are_those_of_the_contract() -> None:
    assert command_of(Frame(0x7F1, bytes.fromhex("0C0001"))) == (12, 1, None)
    assert command_of(Frame(0x7F1, bytes.fromhex("0C01010500"))) == (268, 1, 5)
    assert command_of(Frame(0x7F1, b"\x01")) is None
    assert command_of(Frame(0x7F0, bytes(3))) is None
    assert state_frame(12, ARRIVED, 86400).data == bytes.fromhex("0C000280510100")


def test_devices_that_use_the_identifiers_of_the_control_are_refused(biped: Any) -> None:
    devices = biped.emulated(biped.sensor("ati_netcanoem", ids={"base": 0x7F})).devices
    with pytest.raises(ConfigError, match="0x7F1"):
        check_ids({"can0": devices})
