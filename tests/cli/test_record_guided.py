# SPDX-License-Identifier: Apache-2.0
"""``comcal record`` at a robot that its source only measures, as typed and as seen."""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from comcal.measure.plan_csv import read_plan, write_plan
from comcal.robot.description import load_robot
from comcal.workflow import extensions
from comcal_sims.robots.table1 import generate

SCRIPT = Path(__file__).with_name("hardware.py")
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Table 1 robot with the first three poses of its plan."""
    folder = tmp_path_factory.mktemp("table1")
    joints = load_robot(generate(folder)).tree.joint_names
    poses = read_plan(folder / "plan.csv", joints)[:3]
    (folder / "plan.csv").unlink()
    write_plan(folder / "plan.csv", poses, joints)
    return folder


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Install the robot on the bench into this process."""
    spec = importlib.util.spec_from_file_location("bench_hardware", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(extensions, "entry_points", module.found)
    return module


def arguments(folder: Path, session: Path, *more: str, source: str = "bench") -> list[str]:
    return ["record", str(folder / "robot.yaml"), "-s", str(session), "--source", source, *more]


def rows_of(session: Path) -> list[dict[str, str]]:
    with (session / "poses.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_without_a_terminal_a_person_reads_plain_lines(
    bench: ModuleType, folder: Path, tmp_path: Path, run: Run
) -> None:
    code, out, err = run(*arguments(folder, tmp_path / "s"))
    assert code == 0, err
    assert "source bench (bench 1.0)\n" in out  # no seed: nothing is simulated
    assert "3 poses in" in out
    assert "lost on the way: l_foot" in out
    assert "pose 1 (1 of 3)" in err
    assert "to go" in err
    assert "pose 1: still after" in err
    assert "\x1b" not in err
    counts = (tmp_path / "s" / "counts.csv").read_text().splitlines()
    assert counts[0] == "pose,rate.l_foot,lost.l_foot,notes"
    assert len(counts) == 4


def test_json_tells_the_losses(bench: ModuleType, folder: Path, tmp_path: Path, run: Run) -> None:
    code, out, _ = run(*arguments(folder, tmp_path / "s", "--json"))
    found = json.loads(out)
    assert code == 0
    assert found["recorded"] == [1, 2, 3]
    assert found["seed"] is None
    assert found["lost"]["l_foot"] > 0


def test_a_commander_needs_consent(
    bench: ModuleType, folder: Path, tmp_path: Path, run: Run
) -> None:
    asked = arguments(folder, tmp_path / "s", "--commander", "motor", "--speed", "0.5")
    code, _, err = run(*asked)
    assert code == 2
    assert "nobody agreed" in err
    assert "--yes" in err
    code, out, err = run(*asked, "--yes")
    assert code == 0, err
    assert "3 poses in" in out


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--commander", "moter"], "did you mean motor"),
        (["--commander", "motor", "--speed", "3", "--yes"], "no speed for a robot beside a person"),
        (["--commander", "motor", "--source", "builtin"], "moves the robot itself"),
        (["--approach", "left"], "both"),
        (["--via", "90"], "via"),
    ],
)
def test_what_cannot_be_commanded_says_why(
    bench: ModuleType, folder: Path, tmp_path: Path, run: Run, more: list[str], words: str
) -> None:
    code, out, err = run(*arguments(folder, tmp_path / "s", *more))
    assert (code, out) == (2, "")
    assert words in err


@pytest.mark.parametrize("mover", [[], ["--commander", "motor", "--speed", "0.5", "--yes"]])
def test_a_robot_is_approached_from_both_sides(
    bench: ModuleType,
    folder: Path,
    tmp_path: Path,
    run: Run,
    mover: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not mover:  # the hand goes where the operator is shown to go
        from comcal.measure import guided

        seen = guided.GuidedWait._show

        def shown(self: Any, look: Any, recent: Any) -> None:
            self._source.goal = look.pose.q
            seen(self, look, recent)

        monkeypatch.setattr(guided.GuidedWait, "_show", shown)
    code, _, err = run(*arguments(folder, tmp_path / "s", "--approach", "both", *mover))
    assert code == 0, err
    rows = rows_of(tmp_path / "s")
    assert [row["pose"] for row in rows] == ["2", "3", "4", "5", "6", "7"]
    joints = load_robot(folder / "robot.yaml").tree.joint_names
    opposite = 0
    for first, second in zip(rows[::2], rows[1::2], strict=True):
        assert first["revisit"] == second["revisit"] == f"pose {int(first['pose']) // 2}"
        for joint in joints:
            one, other = (row[f"approach.{joint}"] for row in (first, second))
            opposite += {one, other} == {"1", "-1"}
            assert abs(float(first[f"q.{joint}"]) - float(second[f"q.{joint}"])) < 0.05
    assert opposite >= 8


def test_both_sides_of_a_simulated_robot_resume_to_the_same_bytes(
    folder: Path, tmp_path: Path, run: Run
) -> None:
    more = ["--approach", "both", "--seed", "5", "--effect", "hysteresis@l_knee:half_width=0.004"]
    whole = arguments(folder, tmp_path / "whole", *more, source="builtin")
    assert run(*whole)[0] == 0
    parts = arguments(folder, tmp_path / "parts", *more, source="builtin")
    joints = load_robot(folder / "robot.yaml").tree.joint_names
    write_plan(tmp_path / "short.csv", read_plan(folder / "plan.csv", joints)[:2], joints)
    assert run(*parts, "--poses", tmp_path / "short.csv")[0] == 0
    assert run(*parts)[0] == 0
    one, other = ((tmp_path / name / "poses.csv").read_bytes() for name in ("whole", "parts"))
    assert one == other
    first, second = rows_of(tmp_path / "whole")[4:6]
    assert first["approach.l_knee"] != second["approach.l_knee"]


def test_a_session_is_not_continued_in_the_other_way(
    folder: Path, tmp_path: Path, run: Run
) -> None:
    once = arguments(folder, tmp_path / "once", source="builtin")
    assert run(*once)[0] == 0
    code, _, err = run(*once, "--approach", "both")
    assert code == 2
    assert "without --approach both" in err


class Terminal:
    """A real terminal with ``comcal`` in it."""

    def __init__(self, arguments: list[str]) -> None:
        self.ours, theirs = pty.openpty()
        self.before = termios.tcgetattr(theirs)
        self.theirs = theirs
        self.shown = ""
        self._seen = 0
        self.process = subprocess.Popen(
            [sys.executable, str(SCRIPT), *arguments],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "40"},
        )

    def until(self, words: str, seconds: float = 20.0) -> None:
        """Read until *words* were shown after what was waited for before."""
        end = time.monotonic() + seconds
        while (at := self.shown.find(words, self._seen)) < 0:
            assert self._read(end - time.monotonic()), f"{words!r} not shown:\n{self.shown}"
        self._seen = at + len(words)

    def type(self, keys: str) -> None:
        os.write(self.ours, keys.encode())

    def end(self, seconds: float = 20.0) -> int:
        """Read to the end; return the exit code."""
        end = time.monotonic() + seconds
        while self.process.poll() is None:
            assert time.monotonic() < end, self.shown
            self._read(0.1)
        while self._read(0.0):
            pass
        return self.process.returncode

    def _read(self, seconds: float) -> bool:
        ready, _, _ = select.select([self.ours], [], [], max(seconds, 0.0))
        if ready:
            self.shown += os.read(self.ours, 65536).decode("utf-8", "replace")
        return bool(ready)


@contextmanager
def terminal(arguments: list[str]) -> Generator[Terminal, None, None]:
    found = Terminal(arguments)
    try:
        yield found
    finally:
        if found.process.poll() is None:
            found.process.kill()
        found.process.wait()
        os.close(found.ours)
        os.close(found.theirs)


def test_keys_and_the_live_table_on_a_real_terminal(folder: Path, tmp_path: Path) -> None:
    with terminal(arguments(folder, tmp_path / "s", source="bench:4,20")) as screen:
        screen.until("wanted")
        screen.until("save and quit")
        screen.type("\x1b[A")  # an arrow key means nothing
        screen.type("s")
        screen.until("pose 1: left out by the operator")
        screen.until("pose 2: still after")
        screen.until("\a")
        screen.type("r")
        screen.until("pose 2 is measured again, as pose 4")
        screen.until("pose 4: still after")
        screen.type("q")
        assert screen.end() == 130
        shown = screen.shown
        assert termios.tcgetattr(screen.theirs) == screen.before
    assert "session saved; the same command goes on" in shown
    for words in ("load", "warmth", "°C", "readings", "CoP", "inside the soles", "to go", "losses"):
        assert words in shown, words
    assert shown.rstrip().endswith("where it stopped")
    assert "\x1b[?25h" in shown  # the cursor is back
    assert [row["pose"] for row in rows_of(tmp_path / "s")] == ["2", "4"]


@pytest.mark.parametrize("how", ["space", "ctrl-c", "hang-up"])
def test_a_commanded_robot_is_stopped_and_the_session_saved(
    folder: Path, tmp_path: Path, how: str
) -> None:
    more = ["--commander", "motor", "--speed", "0.05"]
    with terminal(arguments(folder, tmp_path / "s", *more, source="bench:1")) as screen:
        screen.until("Type yes")
        screen.type("yes\n")
        screen.until("wanted")
        started = time.monotonic()
        if how == "hang-up":
            os.kill(screen.process.pid, signal.SIGHUP)
        else:
            screen.type(" " if how == "space" else "\x03")
        assert screen.end() == 130
        assert time.monotonic() - started < 3.0
        assert termios.tcgetattr(screen.theirs) == screen.before
        assert "session saved" in screen.shown
