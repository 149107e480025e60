# SPDX-License-Identifier: Apache-2.0
"""``comcal import`` as typed; a quasi-static import of real data is in tests/golden/bowing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from comcal.cli.main import main
from comcal.measure.session import open_session


@pytest.fixture
def folder(tmp_path: Path, root: Path) -> Path:
    """The nineteen human postures: a log in which each row is a pose."""
    shutil.copytree(root / "tests" / "golden" / "cotton2009", tmp_path / "log")
    return tmp_path / "log"


def arguments(folder: Path, session: Path, *more: str) -> list[str]:
    typed = ["import", str(folder / "table1.csv"), "--map", str(folder / "map.yaml")]
    return [*typed, "-s", str(session), *more]


def test_it_says_how_many_poses_and_what_to_type_next(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "session"
    assert main(arguments(folder, session)) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert f"19 poses of human in the frontal plane in {session / 'poses.csv'}" in lines
    assert next(line for line in lines if line.startswith("joints moved by theta1 "))
    assert lines[-1] == f"next: comcal solve {session}"
    assert err == ""
    assert len(open_session(session).finished_poses()) == 19


def test_json_is_all_that_is_printed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "session"
    assert main(arguments(folder, session, "--json")) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert outcome["format"] == "comcal-import/1"
    assert outcome["session"] == str(session)
    assert outcome["poses"] == 19
    assert outcome["quasi_static"] is False
    assert set(outcome["joint_ranges"]) == {f"theta{k}" for k in range(1, 7)}


def test_a_folder_that_holds_something_is_left_as_it_is(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "session"
    session.mkdir()
    (session / "mine.txt").write_text("mine")
    assert main(arguments(folder, session)) == 2
    assert "nothing is ever overwritten" in capsys.readouterr().err
    assert [p.name for p in session.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("break_it", "code", "words"),
    [
        (lambda f: (f / "map.yaml").unlink(), 2, "map.yaml"),
        (lambda f: (f / "table1.csv").unlink(), 2, "table1.csv"),
        (lambda f: (f / "robot.yaml").unlink(), 2, "robot.yaml"),
        (lambda f: (f / "table1.csv").write_text("pose,theta1\n1,0\n"), 2, "no column"),
    ],
)
def test_what_is_missing_is_named_and_nothing_is_left_behind(
    break_it, code: int, words: str, folder: Path, tmp_path: Path, capsys
) -> None:
    break_it(folder)
    assert main(arguments(folder, tmp_path / "session")) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert words in err
    assert [p.name for p in tmp_path.iterdir()] == ["log"]


def test_quasi_static_needs_masses(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(folder, tmp_path / "session", "--quasi-static")) == 2
    assert "chain without URDF" in capsys.readouterr().err


def test_the_map_must_be_given(folder: Path, tmp_path: Path, capsys) -> None:
    assert main(["import", str(folder / "table1.csv"), "-s", str(tmp_path / "s")]) == 2
    assert "--map" in capsys.readouterr().err
