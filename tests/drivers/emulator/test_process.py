# SPDX-License-Identifier: Apache-2.0
"""The emulator as a process: it serves python-can's clients, and never outlives its parent."""

from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, cast

import can
import pytest

from comcal_drivers.emulator.command import serve
from comcal_drivers.emulator.faults import fault_from
from comcal_drivers.emulator.opening import Options, RunningEmulator
from comcal_drivers.emulator.parent import Leash

WAIT = 5.0
MOVE, MOVING, ARRIVED, REFUSED = 1, 1, 2, 3
Start = Callable[..., AbstractContextManager[Any]]
Row = tuple[int, bytes]


def opened(connection: dict[str, object]) -> can.BusABC:
    options = dict(connection)
    if options["interface"] == "slcan":
        options["sleep_after_open"] = 0.0
    return can.Bus(**cast("dict[str, str]", options))


def command(bus: can.BusABC, pose: int, code: int = MOVE, *more: int) -> None:
    data = struct.pack("<HB", pose, code) + b"".join(struct.pack("<H", m) for m in more)
    bus.send(can.Message(arbitration_id=0x7F1, data=data, is_extended_id=False))


def received(bus: can.BusABC) -> can.Message:
    message = bus.recv(WAIT)
    assert message is not None, "nothing came"
    return message


def until_arrived(bus: can.BusABC, pose: int) -> int:
    """Return the count at which the pose begins."""
    while True:
        message = received(bus)
        if message.arbitration_id == 0x7F2:
            at, state, count = struct.unpack("<HBI", message.data)
            if state != MOVING:
                assert (at, state) == (pose, ARRIVED)
                return count


def rows(bus: can.BusABC, n: int) -> list[Row]:
    return [(m.arbitration_id, bytes(m.data)) for m in (received(bus) for _ in range(n))]


def recorded(bus: can.BusABC, poses: tuple[int, ...], n: int = 600) -> dict[int, list[Row]]:
    """Go to each pose and return the first frames of it."""
    out = dict[int, list[Row]]()
    for pose in poses:
        command(bus, pose)
        count = until_arrived(bus, pose)
        assert count == pose * 7200
        out[pose] = rows(bus, n)
    return out


ARGUMENTS = ("--rate", "0", "--started", "--seed", "5")


@pytest.fixture(scope="module")
def processes(emulators: Start) -> Iterator[dict[str, Any]]:
    """One process of each kind, both started before either is waited for.

    At the end they are called off, and leave nothing behind.
    """
    slcan = ("--adapter", "slcan", *ARGUMENTS)
    socketcand = ("--adapter", "socketcand", *ARGUMENTS)
    with emulators(slcan, socketcand) as (one, two):
        port = Path(str(one.buses["can0"]["channel"]))
        assert port.exists()
        yield {"slcan": one, "socketcand": two}
    assert [one.popen.returncode, two.popen.returncode] == [0, 0]
    assert not port.is_symlink()


def test_every_path_and_every_repetition_sends_the_same_frames(
    processes: dict[str, Any], biped: Any
) -> None:
    poses = tuple(p.pose for p in biped.plan[:3])
    paths = dict[str, dict[int, list[Row]]]()
    for adapter, process in processes.items():
        with opened(process.buses["can0"]) as bus:
            paths[adapter] = recorded(bus, (*poses, poses[0]))
    options = Options(biped.yaml, rate=0.0, started=True, seed=5)
    with RunningEmulator(options) as buses, opened(dict(buses["can0"])) as bus:
        paths["virtual"] = recorded(bus, (poses[2], poses[1], poses[0]))
    assert paths["slcan"] == paths["socketcand"] == paths["virtual"]
    assert len({frame for frames in paths["slcan"].values() for frame in frames}) > 1000


def test_poses_that_cannot_be_taken_are_refused(processes: dict[str, Any]) -> None:
    with opened(processes["socketcand"].buses["can0"]) as bus:
        command(bus, 999)
        states = list[tuple[int, int]]()
        while len(states) < 2:
            message = received(bus)
            if message.arbitration_id == 0x7F2:
                states.append(struct.unpack("<HBI", message.data)[:2])
    assert states == [(999, MOVING), (999, REFUSED)]


def test_a_repetition_has_a_number_of_its_own(processes: dict[str, Any], biped: Any) -> None:
    with opened(processes["slcan"].buses["can0"]) as bus:
        command(bus, 500, MOVE, biped.plan[0].pose)
        assert until_arrived(bus, 500) == 500 * 7200


def test_a_paced_robot_takes_its_time(biped: Any) -> None:
    options = Options(biped.yaml, rate=4.0, started=True)
    with RunningEmulator(options) as buses, opened(dict(buses["can0"])) as bus:
        command(bus, biped.plan[0].pose)
        until_arrived(bus, biped.plan[0].pose)
        start = time.monotonic()
        stamps = [received(bus).timestamp for _ in range(5 * 240)]
        took = time.monotonic() - start
    assert stamps[-1] - stamps[0] == pytest.approx(2.0, abs=0.02)
    assert 0.45 < took < 2.0
    assert stamps == sorted(stamps)


def test_faults_are_done_and_written_down(biped: Any, tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    pose = biped.plan[0].pose
    faults = (fault_from("drop:device=l_foot,part=1,at=20"),)
    options = Options(biped.yaml, rate=0.0, started=True, faults=faults, truth=truth)
    with RunningEmulator(options) as buses, opened(dict(buses["can0"])) as bus:
        frames = recorded(bus, (pose,))[pose]
    note = json.loads(truth.read_text().splitlines()[0])
    assert note["fault"] == "drop"
    assert (note["sample"], note["part"], note["id"]) == (pose * 7200 + 20, 1, "681")
    forces, moments = ({d[6:] for i, d in frames if i == n} for n in (0x601, 0x681))
    assert forces - moments == {struct.pack("<H", (pose * 7200 + 20) % 65536)}


def test_an_outage_ends_and_the_robot_goes_on(biped: Any) -> None:
    pose = biped.plan[0].pose
    faults = (fault_from("bus_off:at=10,duration=0.2"),)
    options = Options(biped.yaml, rate=0.0, started=True, faults=faults)
    with RunningEmulator(options) as buses, opened(dict(buses["can0"])) as bus:
        command(bus, pose)
        until_arrived(bus, pose)
        before = rows(bus, 10 * 5)
        error = received(bus)
        start = time.monotonic()
        after = [m for m in (received(bus) for _ in range(10)) if not m.is_error_frame]
        assert time.monotonic() - start > 0.15
    assert error.is_error_frame
    counters = [struct.unpack("<H", d[6:])[0] for i, d in before if i == 0x601]
    first = next(m for m in after if m.arbitration_id == 0x601)
    lost = struct.unpack("<H", first.data[6:])[0] - counters[-1] - 1
    assert lost == pytest.approx(0.2 * 120, abs=1)


def test_no_process_outlives_its_parent(biped: Any) -> None:
    script = (
        "import subprocess, sys, os\n"
        "child = subprocess.Popen([sys.executable, '-m', 'comcal_drivers.emulator', "
        f"{str(biped.yaml)!r}, '--adapter', 'socketcand'], stdout=subprocess.PIPE, text=True)\n"
        "child.stdout.readline()\n"
        "print(child.pid, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=False
    )
    pid = int(done.stdout)
    end = time.monotonic() + WAIT
    while _lives(pid):
        assert time.monotonic() < end, "the emulator outlived its parent"
        time.sleep(0.02)


def _lives(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--fault", "dorp"), "did you mean drop?"),
        (("--fault", "status:device=l_foot"), "devices that can: l_knee, r_foot"),
        (("--source", "replay:x"), "use one of builtin, pybullet, mujoco"),
    ],
)
def test_what_cannot_work_ends_with_words(
    biped: Any, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    previous = {n: signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    try:
        assert serve([str(biped.yaml), *arguments], Leash()) == 2
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    out, err = capsys.readouterr()
    assert words in err
    assert out == ""
