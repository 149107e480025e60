# SPDX-License-Identifier: Apache-2.0
"""A recording that is killed at any moment loses no finished pose and ends in the same bytes.

``COMCAL_KILLS`` sets the number of kills (10 by default).
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.measure.poses_csv import read_poses
from comcal.measure.session import open_session
from comcal.robot.description import load_robot
from comcal_sims.robots.table1 import generate

KILLS = int(os.environ.get("COMCAL_KILLS", "10"))
SEED = 20170


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table1")
    generate(folder)
    return folder


@pytest.fixture(scope="module")
def whole(folder: Path) -> Path:
    """A recording that nobody disturbed."""
    assert main(arguments(folder, folder / "whole")) == 0
    return folder / "whole"


def arguments(folder: Path, session: Path) -> list[str]:
    words = ["record", str(folder / "robot.yaml"), "-s", str(session)]
    return [*words, "--source", "builtin", "--seed", str(SEED)]


def start(folder: Path, session: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "comcal", *arguments(folder, session)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        # Compiled modules are kept, whatever the caller's settings: starting takes half as long.
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": f"{folder}/cache"},
        # Without it a Ctrl-C of whoever runs the tests would count as one of ours.
        start_new_session=True,
    )


def files(session: Path) -> list[Path]:
    return sorted(session.rglob("*"))


def wait_for(process: subprocess.Popen[bytes], path: Path, lines: int = 0) -> None:
    """Wait until *path* exists and has some lines, or the process ends."""
    while process.poll() is None:
        if path.exists() and (not lines or path.read_bytes().count(b"\n") > lines):
            return
        time.sleep(0.002)


def check(session: Path, whole: Path) -> int:
    """Whatever is in *session* equals the beginning of *whole*; return the finished poses."""
    if not (session / "session.yaml").exists():
        return 0
    opened = open_session(session)
    load_robot(opened.robot_yaml)
    finished = opened.finished_poses()
    if finished:
        table = opened.poses_csv.read_bytes()
        complete = table[: table.rfind(b"\n") + 1]
        assert (whole / "poses.csv").read_bytes().startswith(complete)
    for pose in finished:
        samples = Path("raw") / f"pose_{pose:03d}.mcap"
        assert (session / samples).read_bytes() == (whole / samples).read_bytes()
    return len(finished)


@pytest.mark.slow
def test_kill_9_at_random_moments_loses_no_finished_pose(
    folder: Path, whole: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(9)
    kills, number = 0, 0
    while kills < KILLS:
        session = tmp_path / str(number)
        finished, number = 0, number + 1
        for _ in range(4):  # then a session is completed, and another one begun
            before = files(session)
            with start(folder, session) as process:
                # Not while it still imports; a third of the kills hit the first files it makes.
                while process.poll() is None and files(session) == before:
                    time.sleep(0.001)
                time.sleep(rng.uniform(0.0, rng.choice([0.01, 0.2, 0.5])))
                process.kill()
                _, err = process.communicate()
            assert err == b""
            now = check(session, whole)
            assert now >= finished
            finished = now
            if process.returncode != -signal.SIGKILL:
                break
            kills += 1
        assert main(arguments(folder, session)) == 0
        assert (session / "poses.csv").read_bytes() == (whole / "poses.csv").read_bytes()
        assert check(session, whole) == 25


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_a_hang_up_or_polite_kill_saves_and_exits_130(
    folder: Path, whole: Path, tmp_path: Path, number: signal.Signals
) -> None:
    session = tmp_path / "s"
    with start(folder, session) as process:
        wait_for(process, session / "poses.csv", lines=3)
        process.send_signal(number)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err.decode().startswith("interrupted, session saved")
    finished = check(session, whole)
    assert 3 <= finished < 25
    assert main(arguments(folder, session)) == 0
    assert (session / "poses.csv").read_bytes() == (whole / "poses.csv").read_bytes()


def test_a_row_that_a_kill_cut_in_half_is_measured_again(
    folder: Path, whole: Path, tmp_path: Path
) -> None:
    session = tmp_path / "s"
    with start(folder, session) as process:
        wait_for(process, session / "poses.csv", lines=4)
        process.kill()
        process.communicate()
    table = session / "poses.csv"
    content = table.read_bytes()
    complete = content[: content.rfind(b"\n") + 1]
    table.write_bytes(complete[:-40])  # what a kill during the last write would leave
    count = complete.count(b"\n") - 2
    assert len(open_session(session).finished_poses()) == count
    assert main(arguments(folder, session)) == 0
    assert table.read_bytes() == (whole / "poses.csv").read_bytes()
    last_line = complete[complete.rfind(b"\n", 0, -1) + 1 :]
    assert (session / "poses.csv.partial-1").read_bytes() == last_line[:-40]
    robot = load_robot(session / "robot.yaml")
    assert len(read_poses(table, robot)) == 25
