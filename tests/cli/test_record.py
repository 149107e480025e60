# SPDX-License-Identifier: Apache-2.0
"""``comcal record`` as typed, with the built-in world. Kills are in test_record_kill.py."""

from __future__ import annotations

import json
import os
import pty
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from comcal.cli.main import main
from comcal.measure.plan_csv import read_plan, write_plan
from comcal.measure.session import open_session
from comcal.robot.description import load_robot
from comcal.workflow import sources
from comcal_sims.robots.table1 import generate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Table 1 robot with the first four poses of its plan."""
    folder = tmp_path_factory.mktemp("table1")
    joints = load_robot(generate(folder)).tree.joint_names
    poses = read_plan(folder / "plan.csv", joints)[:4]
    (folder / "plan.csv").unlink()
    write_plan(folder / "plan.csv", poses, joints)
    return folder


def arguments(folder: Path, session: Path, *more: str) -> list[str]:
    return ["record", str(folder / "robot.yaml"), "-s", str(session), "--source", "builtin", *more]


def ids(folder: Path) -> list[int]:
    joints = load_robot(folder / "robot.yaml").tree.joint_names
    return [pose.pose for pose in read_plan(folder / "plan.csv", joints)]


def test_the_seed_is_printed_and_makes_the_same_rows_again(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(folder, tmp_path / "a")) == 0
    out, err = capsys.readouterr()
    seed = open_session(tmp_path / "a").seed
    assert f"seed {seed}" in out
    assert "4 poses" in out
    assert err == ""  # no progress where there is no terminal
    assert main(arguments(folder, tmp_path / "b", "--seed", str(seed))) == 0
    assert main(arguments(folder, tmp_path / "c", "--seed", str(seed + 1))) == 0
    first, same, other = ((tmp_path / x / "poses.csv").read_bytes() for x in "abc")
    assert first == same != other


def test_json_is_alone_on_standard_output(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(folder, tmp_path / "s", "--json", "--seed", "1")) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["recorded"] == ids(folder)
    assert found["seed"] == 1
    assert found["skipped"] == found["before"] == found["superseded"] == []
    assert found["engine"].startswith("builtin")


def test_redo_measures_again_under_a_new_number(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    planned = ids(folder)
    assert main(arguments(folder, tmp_path / "s", "--redo", "1")) == 2
    assert "nothing to measure again" in capsys.readouterr().err
    assert main(arguments(folder, tmp_path / "s")) == 0
    capsys.readouterr()
    again = arguments(folder, tmp_path / "s", "--redo", str(planned[1]), "--json")
    assert main(again) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["recorded"] == [max(planned) + 1]
    assert found["superseded"] == [planned[1]]
    assert main(again) == 0
    assert json.loads(capsys.readouterr().out)["superseded"] == [planned[1], max(planned) + 1]
    assert main(arguments(folder, tmp_path / "s", "--redo", "99")) == 2
    assert "pose 99" in capsys.readouterr().err


def test_without_noise_the_engine_is_seen(folder: Path, tmp_path: Path) -> None:
    assert main(arguments(folder, tmp_path / "a", "--no-noise", "--seed", "1")) == 0
    assert main(arguments(folder, tmp_path / "b", "--no-noise", "--seed", "2")) == 0
    rows = [(tmp_path / x / "poses.csv").read_bytes() for x in "ab"]
    assert rows[0] == rows[1]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--seed", "8"], "another seed"),
        (["--no-noise"], "begun with noise"),
        (["--source", "mujoco"], "another source"),
    ],
)
def test_a_session_goes_on_only_as_it_was_begun(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    words: str,
) -> None:
    assert main(arguments(folder, tmp_path / "s", "--seed", "7")) == 0
    before = (tmp_path / "s" / "poses.csv").read_bytes()
    capsys.readouterr()
    assert main(arguments(folder, tmp_path / "s", *more)) == 2
    assert words in capsys.readouterr().err
    assert (tmp_path / "s" / "poses.csv").read_bytes() == before


def test_a_longer_plan_goes_on_where_the_shorter_one_ended(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joints = load_robot(folder / "robot.yaml").tree.joint_names
    poses = read_plan(folder / "plan.csv", joints)
    write_plan(tmp_path / "short.csv", poses[:2], joints)
    short = arguments(folder, tmp_path / "s", "--poses", str(tmp_path / "short.csv"), "--seed", "1")
    assert main(short) == 0
    assert main(arguments(folder, tmp_path / "s", "--json")) == 0
    assert json.loads(capsys.readouterr().out.partition("{")[2].join(["{", ""]))["before"] == [
        pose.pose for pose in poses[:2]
    ]
    assert main(arguments(folder, tmp_path / "whole", "--seed", "1")) == 0
    whole, parts = ((tmp_path / x / "poses.csv").read_bytes() for x in ("whole", "s"))
    assert whole == parts


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (["--source", "pybulet"], 2, "did you mean pybullet"),
        (["--poses", "nowhere.csv"], 2, "nowhere.csv"),
        (["--still-sd", "0.001"], 3, "standard deviation of CoP"),
        (["--still-sd", "-1"], 2, "still-sd"),
        (["--seed", "one"], 2, "one"),
    ],
)
def test_what_cannot_work_says_why_and_has_its_exit_code(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: list[str],
    code: int,
    words: str,
) -> None:
    assert main(arguments(folder, tmp_path / "s", *change)) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert len(err.splitlines()) == 1
    if code == 2:
        assert not (tmp_path / "s").exists()


def test_a_missing_engine_names_the_line_to_type(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def needs_pybullet(request: Any) -> None:
        raise ModuleNotFoundError("No module named 'pybullet'", name="pybullet")

    monkeypatch.setattr(EntryPoint, "load", lambda self: needs_pybullet)
    assert main(arguments(folder, tmp_path / "s")) == 6
    assert "pip install 'comcal[sim]'" in capsys.readouterr().err


def test_every_source_of_this_project_is_installed() -> None:
    assert {"builtin", "pybullet", "mujoco"} <= set(sources.source_names())


def test_a_changed_robot_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = shutil.copytree(folder, tmp_path / "mine")
    assert main(arguments(mine, tmp_path / "s")) == 0
    (mine / "robot.yaml").write_text((mine / "robot.yaml").read_text() + "\n# heavier\n")
    capsys.readouterr()
    assert main(arguments(mine, tmp_path / "s")) == 2
    assert "robot.yaml: has changed" in capsys.readouterr().err


def test_a_terminal_sees_one_line_per_pose_on_standard_error(folder: Path, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "comcal", *arguments(folder, tmp_path / "s", "--seed", "4")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=theirs, env={**os.environ, "TERM": "xterm"}
    ) as process:
        os.close(theirs)
        shown = b""
        try:
            while piece := os.read(ours, 4096):
                shown += piece
        except OSError:  # Linux says so when the other end is closed
            pass
        assert process.stdout is not None
        out = process.stdout.read().decode()
    os.close(ours)
    assert process.returncode == 0
    assert "seed 4" in out
    for pose in ids(folder):
        assert f"pose {pose}: still after".encode() in shown
