# SPDX-License-Identifier: Apache-2.0
"""The session folder. Not covered: power failures; kills of whole processes are in tests/cli."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import ConfigError, DataError, UsageError
from comcal.measure.rows import append_row, column_numbers, repair_tail
from comcal.measure.session import create_session, open_session
from comcal.robot.description import load_robot
from comcal.robot.model import Robot

ROW = {"pose": 1, "configuration": "a, b", "q.knee": 0.1, "n": None}


def folder_content(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def test_the_frozen_copy_loads_by_itself_and_is_the_same_robot(
    robot: Robot, tmp_path: Path
) -> None:
    session = create_session(tmp_path / "s", robot, source="fake", seed=3)
    frozen = load_robot(session.robot_yaml)
    assert frozen.tree.joint_names == robot.tree.joint_names
    np.testing.assert_array_equal(frozen.tree.masses, robot.tree.masses)
    assert robot.yaml_path is not None
    assert session.robot_yaml.read_bytes() == robot.yaml_path.read_bytes()
    assert session.seed == 3


def test_a_urdf_elsewhere_is_copied_and_the_reference_follows_it(
    robot_folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "urdf").mkdir()
    (tmp_path / "config").mkdir()
    shutil.copy(robot_folder / "table1.urdf", tmp_path / "urdf" / "table1.urdf")
    text = (robot_folder / "robot.yaml").read_text()
    assert "urdf: table1.urdf" in text
    text = "# my robot\n" + text.replace("urdf: table1.urdf", "urdf: ../urdf/table1.urdf  # here")
    (tmp_path / "config" / "robot.yaml").write_text(text)
    robot = load_robot(tmp_path / "config" / "robot.yaml")
    session = create_session(tmp_path / "s", robot, source="fake")
    shutil.rmtree(tmp_path / "urdf")
    frozen = load_robot(session.robot_yaml)
    assert frozen.urdf_path == tmp_path / "s" / "table1.urdf"
    content = session.robot_yaml.read_text()
    assert content.startswith("# my robot\n")
    assert "# here" in content
    create_session(tmp_path / "s", frozen, source="fake")  # the copy goes on where it was begun


def test_a_foreign_folder_is_refused_and_left_alone(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(UsageError, match="not empty"):
        create_session(tmp_path, robot, source="fake")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(UsageError, match=r"no session\.yaml"):
        open_session(tmp_path)


def test_a_creation_that_was_killed_is_completed(robot: Robot, tmp_path: Path) -> None:
    session = create_session(tmp_path / "s", robot, source="fake", seed=1)
    session.session_yaml.unlink()  # what a kill before the last step leaves behind
    again = create_session(tmp_path / "s", robot, source="fake", seed=1)
    assert again.seed == 1


def test_another_experiment_does_not_go_into_the_same_folder(
    robot: Robot, robot_folder: Path, tmp_path: Path
) -> None:
    session = create_session(tmp_path / "s", robot, source="fake", seed=1)
    before = folder_content(session.directory)
    create_session(tmp_path / "s", robot, source="fake", seed=1)
    with pytest.raises(UsageError, match="another source"):
        create_session(tmp_path / "s", robot, source="other", seed=1)
    with pytest.raises(UsageError, match="another seed"):
        create_session(tmp_path / "s", robot, source="fake", seed=2)
    changed = shutil.copytree(robot_folder, tmp_path / "changed")
    urdf = changed / "table1.urdf"
    urdf.write_text(urdf.read_text() + "<!-- edited -->\n")
    with pytest.raises(ConfigError, match=r"table1\.urdf: has changed"):
        create_session(tmp_path / "s", load_robot(changed / "robot.yaml"), source="fake", seed=1)
    assert folder_content(session.directory) == before


def test_a_robot_without_a_file_cannot_be_frozen(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"robot\.yaml"):
        create_session(tmp_path / "s", replace(robot, yaml_path=None))


def test_rows_are_read_back_exactly_and_ids_are_unique(robot: Robot, tmp_path: Path) -> None:
    session = create_session(tmp_path / "s", robot)
    value = 0.1 + 0.2
    session.append_pose({**ROW, "q.knee": value})
    session.append_pose({"pose": 2, "q.knee": -1e-300})
    with session.poses_csv.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["q.knee"]) for row in rows] == [value, -1e-300]
    assert rows[0]["configuration"] == "a, b"
    assert rows[1]["n"] == ""
    assert session.finished_poses() == (1, 2)
    with pytest.raises(ConfigError, match="finished already"):
        session.append_pose({"pose": 2})
    with pytest.raises(ConfigError, match=r"no column ft\.new"):
        session.append_pose({"pose": 3, "ft.new": 1.0})
    with pytest.raises(ConfigError, match="line break"):
        session.append_pose({"pose": 3, "configuration": "a\nb"})
    assert session.finished_poses() == (1, 2)


def test_a_repetition_replaces_the_old_row_only_when_it_is_finished(
    robot: Robot, tmp_path: Path
) -> None:
    session = create_session(tmp_path / "s", robot)
    session.append_pose(ROW)
    session.plan_repetition(1, as_pose=7)
    assert session.superseded() == ()
    session.append_pose({**ROW, "pose": 7})
    assert session.superseded() == (1,)
    assert open_session(session.directory).metadata["superseded"] == [1]
    assert session.finished_poses() == (1, 7)
    # Killed between row and note: the next writer catches up.
    session.update(superseded=[])
    with session.lock():
        assert session.metadata["superseded"] == [1]


def test_tares_come_back_and_damaged_ones_are_refused(robot: Robot, tmp_path: Path) -> None:
    tare = {"l_foot": {"value": [1, 2, 3, 4, 5, 6.5], "sigma": [0.1] * 6}}
    session = create_session(tmp_path / "s", robot, details={"tare": tare})
    value, sigma = session.tares()["l_foot"]
    assert value.tolist() == [1, 2, 3, 4, 5, 6.5]
    assert sigma.tolist() == [0.1] * 6
    session.update(tare={"l_foot": {"value": [1, 2, 3]}})
    with pytest.raises(ConfigError, match="l_foot"):
        session.tares()


def test_a_changed_input_is_noticed_and_both_are_remembered(robot: Robot, tmp_path: Path) -> None:
    session = create_session(tmp_path / "s", robot)
    plan = tmp_path / "plan.csv"
    plan.write_text("one")
    assert session.note_input(plan)
    assert session.note_input(plan)
    plan.write_text("two")
    assert not session.note_input(plan)
    assert not session.note_input(plan)
    names = [name for name in session.metadata["sha256"] if name.startswith("plan.csv")]
    assert names == ["plan.csv", "plan.csv (2)"]


def test_results_are_numbered_and_latest_moves_only_when_published(
    robot: Robot, tmp_path: Path
) -> None:
    session = create_session(tmp_path / "s", robot)
    first = session.new_result_folder()
    latest = session.directory / "results" / "latest"
    assert not latest.exists()
    session.publish_result(first)
    (first / "result.json").write_text("{}")
    second = session.new_result_folder()
    assert [first.name, second.name] == ["001", "002"]
    assert (latest / "result.json").is_file()
    session.publish_result(second)
    assert latest.resolve() == second.resolve()


def test_two_recorders_exclude_one_another_until_the_first_is_gone(
    robot: Robot, tmp_path: Path
) -> None:
    session = create_session(tmp_path / "s", robot)
    holder = (
        "import sys, pathlib, time\n"
        "from comcal.measure.session import open_session\n"
        "with open_session(pathlib.Path(sys.argv[1])).lock():\n"
        "    print('held', flush=True)\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", holder, str(session.directory)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(UsageError, match="another process"):
            session.append_pose(ROW)
        assert session.finished_poses() == ()  # reading needs no lock
        process.kill()
        process.wait()
    session.append_pose(ROW)
    assert session.finished_poses() == (1,)


def test_rubbish_in_session_yaml_is_refused_with_its_place(robot: Robot, tmp_path: Path) -> None:
    session = create_session(tmp_path / "s", robot)
    for rubbish in (b"", b"[", b"\xff\xfe", b"format: other/1\n", b"- 1\n", b"a: &x [*x]\n"):
        session.session_yaml.write_bytes(rubbish)
        with pytest.raises(ConfigError, match=r"session\.yaml"):
            open_session(session.directory)


WORDS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), max_size=8)
ROWS = st.lists(
    st.tuples(WORDS, st.floats(allow_nan=False, allow_infinity=False)), min_size=1, max_size=6
)


@settings(max_examples=50)
@given(rows=ROWS, data=st.data())
def test_a_table_cut_off_anywhere_keeps_all_complete_rows_and_loses_no_byte(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[str, float]],
    data: st.DataObject,
) -> None:
    path = tmp_path_factory.mktemp("cut") / "poses.csv"
    for k, (word, number) in enumerate(rows):
        append_row(path, {"pose": k, "configuration": word, "x": number})
    whole = path.read_bytes()
    cut = data.draw(st.integers(0, len(whole)))
    path.write_bytes(whole[:cut])
    complete = max(whole[:cut].count(b"\n") - 1, 0)

    assert column_numbers(path, ("pose",))[:, 0].tolist() == list(range(complete))
    aside = repair_tail(path)

    kept = path.read_bytes() if path.exists() else b""
    assert kept + (aside.read_bytes() if aside else b"") == whole[:cut]
    assert repair_tail(path) is None
    for k, (word, number) in enumerate(rows[complete:], complete):
        append_row(path, {"pose": k, "configuration": word, "x": number})
    assert path.read_bytes() == whole


def test_pieces_of_several_kills_are_all_kept(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    append_row(path, {"pose": 1})
    for _ in range(2):
        with path.open("ab") as file:
            file.write(b"2")
        repair_tail(path)
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["poses.csv", "poses.csv.partial-1", "poses.csv.partial-2"]


def test_a_full_disk_leaves_no_half_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    path = tmp_path / "poses.csv"
    append_row(path, {"pose": 1, "x": 2.0})
    before, write = path.read_bytes(), os.write
    calls: list[int] = []

    def full(descriptor: int, data: bytes) -> int:
        calls.append(1)
        if len(calls) > 1:
            raise OSError(28, "No space left on device")
        return write(descriptor, data[:2])

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OSError, match="No space"):
        append_row(path, {"pose": 2, "x": 3.0})
    assert path.read_bytes() == before


@settings(max_examples=50)
@given(st.one_of(st.binary(max_size=200), st.just(b"x,y\n1,2\n"), st.just(b"pose\none\n")))
def test_rubbish_in_the_table_is_a_data_error_at_worst(
    tmp_path_factory: pytest.TempPathFactory, rubbish: bytes
) -> None:
    path = tmp_path_factory.mktemp("rubbish") / "poses.csv"
    path.write_bytes(rubbish)
    if b"\n" not in rubbish:  # nothing of it was ever finished
        assert column_numbers(path, ("pose",)).shape == (0, 1)
        return
    with pytest.raises(DataError, match=r"poses\.csv"):
        column_numbers(path, ("pose",))
