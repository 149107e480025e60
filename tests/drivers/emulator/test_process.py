# SPDX-License-Identifier: Apache-2.0
"""The emulator as a process: it serves python-can's clients, and never outlives its parent."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import socket
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
    while True:
        try:
            message = bus.recv(WAIT)
        except (ValueError, IndexError):
            # The rest of a line that was cut when the host before this one left: python-can takes
            # it for a frame if it begins with a letter.
            continue
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
        start = time.monotonic()
        command(bus, biped.plan[0].pose)
        until_arrived(bus, biped.plan[0].pose)
        stamps = [received(bus).timestamp for _ in range(5 * 240)]
        took = time.monotonic() - start
    assert stamps[-1] - stamps[0] == pytest.approx(2.0, abs=0.02)
    assert 0.49 < took < 5.0
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


@pytest.mark.parametrize("adapter", ["slcan", "socketcand"])
def test_an_unplugged_adapter_loses_what_the_truth_says(
    adapter: str, biped: Any, tmp_path: Path
) -> None:
    pose, truth = biped.plan[0].pose, tmp_path / "truth.jsonl"
    faults = (fault_from("disconnect:at=30,duration=0.2,times=1"),)
    options = Options(biped.yaml, rate=0.0, started=True, faults=faults, truth=truth, length=1.0)
    with RunningEmulator(options, adapter) as buses:
        before = raw_lines(buses["can0"], b"t7F13" + struct.pack("<HB", pose, MOVE).hex().encode())
        after = raw_lines(buses["can0"], b"", idle=0.3)
    # Forces of the JR3: the sample number is in the last two bytes.
    first, second = ([int.from_bytes(d[6:], "little") for d in lines] for lines in (before, after))
    begin = pose * 7200 % 65536
    assert first == list(range(begin, begin + 30))
    assert second == list(range(begin + 54, begin + 120))
    notes = [json.loads(line) for line in truth.read_text().splitlines()]
    assert notes[1]["lost"] == {"l_foot": 24, "r_foot": 24, "l_knee": 24}


def raw_fd(connection: Any) -> int:
    if connection["interface"] == "slcan":
        return os.open(connection["channel"], os.O_RDWR | os.O_NOCTTY)
    return socket.create_connection((connection["host"], connection["port"])).detach()


def raw_lines(connection: Any, command_: bytes, idle: float = WAIT) -> list[bytes]:
    """Read the forces of the JR3 without python-can, until the adapter is gone or says no more."""
    fd = -1
    end = time.monotonic() + WAIT
    while fd < 0:
        assert time.monotonic() < end, "the adapter does not come back"
        with contextlib.suppress(OSError):
            fd = raw_fd(connection)
    if connection["interface"] == "slcan":
        os.write(fd, b"C\rS8\rO\r" + (command_ + b"\r" if command_ else b""))
        pattern = re.compile(rb"t6018([0-9A-F]{16})\r")
    else:
        os.write(fd, b"< open can0 >< rawmode >")
        if command_:
            data = b" ".join(command_[5 + k : 7 + k] for k in (0, 2, 4))
            os.write(fd, b"< send 7f1 3 " + data + b" >")
        pattern = re.compile(rb"< frame 601 [0-9.]+ ([0-9A-F]{16}) >")
    text = b""
    try:
        while select.select([fd], [], [], idle)[0] and (piece := os.read(fd, 4096)):
            text += piece
    except OSError:
        pass
    finally:
        os.close(fd)
    return [bytes.fromhex(found.decode()) for found in pattern.findall(text)]


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
        (("--source", "replay:x"), "use one of builtin, mujoco, pybullet"),
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
