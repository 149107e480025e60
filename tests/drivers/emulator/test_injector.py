# SPDX-License-Identifier: Apache-2.0
"""Every fault does what it says, nothing else, and is written down before it is on the bus."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest

from comcal.errors import ConfigError
from comcal_drivers.emulator.faults import KINDS, fault_from
from comcal_drivers.emulator.frame import Frame
from comcal_drivers.emulator.injector import Injector, Outage, check_faults
from comcal_drivers.emulator.robot import EmulatedRobot
from comcal_drivers.emulator.truth import TruthLog

POSE, SAMPLES = 3, 200
FIRST = POSE * 7200


class Run:
    """A pose of a robot with a JR3 and an IIT strain board, through an injector."""

    def __init__(self, biped: Any, path: Path, *faults: str) -> None:
        robot: EmulatedRobot = biped.emulated(
            biped.sensor("jr3_uc3m"), biped.sensor("iit_strain", "r_foot")
        )
        self.layouts = {device.name: device.layout for device in robot.devices}
        made = tuple(fault_from(text) for text in faults)
        check_faults(made, self.layouts)
        truth = TruthLog(path / "truth.jsonl")
        injector = Injector("can0", made, self.layouts, truth)
        self.count = robot.take(POSE).count
        injector.begin(POSE)
        self.announced = injector.announced("l_foot", self.count)
        self.clean, self.out = list[Frame](), list[Frame | Outage]()
        for _ in range(SAMPLES):
            tick = robot.tick()
            assert tick is not None
            self.clean += tick.frames["can0"]
            self.out += injector.inject(tick.frames["can0"])
        self.out += injector.release()
        truth.close()
        self.truth = [json.loads(line) for line in (path / "truth.jsonl").read_text().splitlines()]

    @property
    def frames(self) -> list[Frame]:
        return [item for item in self.out if isinstance(item, Frame)]

    def of(self, device: str) -> list[Frame]:
        return [frame for frame in self.frames if frame.device == device]


def counters(frames: list[Frame]) -> list[int]:
    return [struct.unpack("<H", f.data[6:8])[0] for f in frames if f.part == 0]


def test_without_faults_everything_passes(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path)
    assert run.out == run.clean
    assert run.truth == []


def test_what_is_dropped_is_missing_and_known(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "drop:probability=0.1,seed=4")
    gone = {(n["device"], n["sample"], n["part"]) for n in run.truth}
    assert len(gone) == len(run.truth) > 20
    assert run.out == [f for f in run.clean if (f.device, f.sample, f.part) not in gone]


def test_what_is_duplicated_comes_twice(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "duplicate:device=l_foot,part=1,at=7")
    assert [n["sample"] for n in run.truth] == [FIRST + 7]
    twice = [f for f in run.clean if (f.device, f.sample, f.part) == ("l_foot", FIRST + 7, 1)]
    i = run.clean.index(twice[0])
    assert run.out == [*run.clean[: i + 1], *twice, *run.clean[i + 1 :]]


@pytest.mark.parametrize("by", [1, 3, 9])
def test_what_is_late_is_so_by_as_many_frames(biped: Any, tmp_path: Path, by: int) -> None:
    run = Run(biped, tmp_path, f"reorder:device=l_foot,part=0,at=7,by={by}")
    late = next(f for f in run.clean if (f.device, f.sample, f.part) == ("l_foot", FIRST + 7, 0))
    assert run.frames.index(late) == run.clean.index(late) + by
    assert sorted(run.frames) == sorted(run.clean)
    assert [f for f in run.frames if f != late] == [f for f in run.clean if f != late]


def test_swapped_halves_are_swapped(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "swap_halves:device=r_foot,probability=0.2")
    struck = {n["sample"] for n in run.truth}
    assert len(struck) > 10
    for sample in range(FIRST, FIRST + SAMPLES):
        parts = [f.part for f in run.of("r_foot") if f.sample == sample]
        assert parts == ([1, 0] if sample in struck else [0, 1])


@pytest.mark.parametrize(("text", "length"), [("", 7), (",length=2", 2), (",length=0", 0)])
def test_lengths_are_wrong_where_it_says(
    biped: Any, tmp_path: Path, text: str, length: int
) -> None:
    run = Run(biped, tmp_path, "dlc:device=l_foot,part=0,at=5" + text)
    wrong = [f for f in run.of("l_foot") if len(f.data) != 8]
    assert [(f.sample, f.part, len(f.data)) for f in wrong] == [(FIRST + 5, 0, length)]
    assert run.truth[0]["length"] == length


def test_saturation_reaches_the_value_and_the_word_about_it(biped: Any, tmp_path: Path) -> None:
    run = Run(
        biped, tmp_path,
        "saturate:device=l_foot,channel=2,at=5", "saturate:device=r_foot,channel=4,low=1,at=6",
    )  # fmt: skip
    force = next(f for f in run.of("l_foot") if (f.sample, f.part) == (FIRST + 5, 0))
    assert struct.unpack("<hhh", force.data[:6])[2] == 32767
    torque = next(f for f in run.of("r_foot") if (f.sample, f.part) == (FIRST + 6, 1))
    assert struct.unpack("<HHH", torque.data[:6])[1] == 0
    assert torque.data[6] == 0b0001_0001
    assert {n["channel"] for n in run.truth} == {2, 4}
    untouched = [f for f in run.frames if f not in (force, torque)]
    assert untouched == [f for f in run.clean if f in untouched]
    assert len(untouched) == len(run.clean) - 2


def test_status_bits_are_set_where_they_belong(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "status:device=r_foot,bit=11,probability=1")
    parts = {k: {f.data[6:] for f in run.of("r_foot") if f.part == k} for k in (0, 1)}
    assert parts == {0: {b""}, 1: {bytes([1 << 3])}}
    assert len(run.truth) == SAMPLES


def test_a_jump_of_the_counter_stays(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "counter_jump:at=10,by=500")
    wanted = [FIRST + n + (500 if n >= 10 else 0) for n in range(SAMPLES)]
    assert counters(run.of("l_foot")) == [n % 65536 for n in wanted]
    assert run.announced == FIRST


def test_a_counter_that_goes_round_in_a_pose_is_announced(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "counter_wrap:device=l_foot,at=0,before=5")
    assert counters(run.of("l_foot")) == [(65531 + n) % 65536 for n in range(SAMPLES)]
    assert run.announced % 65536 == 65531


def test_a_step_of_the_clock_moves_all_later_stamps(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "clock_step:at=50,by=-2.5")
    steps = [round(b.t - a.t, 6) for a, b in zip(run.clean, run.frames, strict=True)]
    assert steps == [0.0] * 200 + [-2.5] * (len(steps) - 200)


@pytest.mark.parametrize("kind", ["silence", "disconnect", "bus_off"])
def test_an_outage_swallows_its_duration(biped: Any, tmp_path: Path, kind: str) -> None:
    run = Run(biped, tmp_path, f"{kind}:at=50,duration=0.5")
    assert [i for i in run.out if isinstance(i, Outage)] == [Outage(kind, 0.5)]
    there = {f.sample - FIRST for f in run.frames}
    assert there == set(range(50)) | set(range(110, SAMPLES))
    assert run.truth[1]["is_over"]
    assert run.truth[1]["lost"] == {"l_foot": 60, "r_foot": 60}


def test_one_device_may_be_silent_alone(biped: Any, tmp_path: Path) -> None:
    run = Run(biped, tmp_path, "silence:device=l_foot,at=50,duration=0.5")
    assert not [i for i in run.out if isinstance(i, Outage)]
    assert len(run.of("l_foot")) == 2 * (SAMPLES - 60)
    assert len(run.of("r_foot")) == 2 * SAMPLES
    assert run.truth[1]["lost"] == {"l_foot": 60}


def test_times_pose_and_seed_are_respected(biped: Any, tmp_path: Path) -> None:
    assert len(Run(biped, tmp_path, "drop:probability=1,times=3").truth) == 3
    assert Run(biped, tmp_path, "drop:probability=1,pose=4").truth == []
    texts = ("drop:probability=0.1,seed=1", "drop:probability=0.1,seed=1")
    runs = [Run(biped, tmp_path, texts[0]).truth, Run(biped, tmp_path, texts[1]).truth]
    assert runs[0] == runs[1] != Run(biped, tmp_path, "drop:probability=0.1,seed=2").truth


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_can_be_written_down(biped: Any, tmp_path: Path, kind: str) -> None:
    run = Run(biped, tmp_path, f"{kind}:at=3")
    assert {n["fault"] for n in run.truth} == {kind}
    assert all(n["pose"] == POSE and n["bus"] == "can0" for n in run.truth)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("dorp", "did you mean drop"),
        ("drop:probabilty=1", "did you mean probability"),
        ("drop:at=x", "a whole number"),
        ("drop:probability=2", "between 0 and 1"),
        ("counter_jump:device=r_foot", "devices that can: l_foot"),
        ("drop:device=nobody", "devices that can: l_foot, r_foot"),
    ],
)
def test_faults_that_cannot_strike_are_refused(
    biped: Any, tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        Run(biped, tmp_path, text)


def test_answers_bear_the_clock_that_has_stepped(biped: Any) -> None:
    robot: EmulatedRobot = biped.emulated(biped.sensor("jr3_uc3m"))
    layouts = {device.name: device.layout for device in robot.devices}
    faults = (fault_from("clock_step:at=1,by=6.5"),)
    injector = Injector("can0", faults, layouts, TruthLog())
    answer = Frame(0x701, b"\5", 2.0)
    injector.inject([])
    assert injector.stamped([answer]) == [answer]
    injector.inject([])
    assert injector.stamped([answer]) == [answer._replace(t=8.5)]
