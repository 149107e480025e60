# SPDX-License-Identifier: Apache-2.0
"""Whatever is wrong with the input: the right exit code, one clear line, files as they were."""

from __future__ import annotations

import csv
import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal_sims.robots import biped14, table1

Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good session of the Table 1 robot, not to be changed."""
    folder = tmp_path_factory.mktemp("good")
    robot = table1.generate(folder / "robot")
    assert (
        main(["record", str(robot), "-s", str(folder / "s"), "--source", "builtin", "--seed", "5"])
        == 0
    )
    return folder / "s"


@pytest.fixture(scope="module")
def recorded14(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good session of the 14-joint robot, not to be changed."""
    folder = tmp_path_factory.mktemp("good14")
    robot = biped14.generate(folder / "robot")
    assert (
        main(["record", str(robot), "-s", str(folder / "s"), "--source", "builtin", "--seed", "5"])
        == 0
    )
    return folder / "s"


@pytest.fixture
def session(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "session", symlinks=True))


@pytest.fixture
def session14(recorded14: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded14, tmp_path / "session14", symlinks=True))


def change(session: Path, edit: Callable[[Rows], Rows | None]) -> None:
    path = session / "poses.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    rows = edit(rows) or rows
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def digest(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and ".lock" not in p.name
    }


def refused(session: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    """Solve; return exit code and the error, having checked that no file changed."""
    before = digest(session)
    capsys.readouterr()
    code = main(["solve", str(session), *options])
    printed = capsys.readouterr()
    assert digest(session) == before
    assert "Traceback" not in printed.err + printed.out
    assert len(printed.err.strip().splitlines()) == 1, printed.err
    return code, printed.err


def scale(rows: Rows, columns: Callable[[str], bool], factor: float) -> Rows:
    for row in rows:
        for name in row:
            if columns(name) and row[name]:
                row[name] = repr(float(row[name]) * factor)
    return rows


def test_the_untouched_session_passes(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["solve", str(session)]) == 0
    assert "Verdict: PASSED" in capsys.readouterr().out


def test_degrees_are_detected_and_said(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(session, lambda rows: scale(rows, lambda c: c.startswith("q."), 180 / np.pi))
    code, text = refused(session, capsys)
    assert code == 3
    assert "degrees" in text


def test_a_wrong_sign_proposes_the_sense(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(session, lambda rows: scale(rows, lambda c: c.startswith("ft."), -1.0))
    code, text = refused(session, capsys)
    assert code == 3
    assert "`sense`" in text
    assert "l_foot: on_ground" in text


def test_kilograms_force_are_detected(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(session, lambda rows: scale(rows, lambda c: c.startswith("ft."), 1 / 9.81))
    code, text = refused(session, capsys)
    assert code == 3
    assert "kgf" in text


def exchange(rows: Rows) -> Rows:
    for row in rows:
        for name in list(row):
            if ".l_foot." in name:
                other = name.replace(".l_foot.", ".r_foot.")
                row[name], row[other] = row[other], row[name]
    return rows


@pytest.mark.parametrize("name", ["session", "session14"])
def test_exchanged_feet_are_recognised(
    name: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = request.getfixturevalue(name)
    change(folder, exchange)
    code, text = refused(folder, capsys)
    assert code == 3
    assert "exchanged" in text


def drop_column(rows: Rows, name: str) -> Rows:
    for row in rows:
        del row[name]
    return rows


def test_a_missing_joint_is_named(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(session, lambda rows: drop_column(rows, "q.l_knee"))
    code, text = refused(session, capsys)
    assert code == 2
    assert "q.l_knee" in text


@pytest.mark.parametrize("cell", ["", "nan", "inf"])
def test_a_cell_without_a_number_is_named_with_its_line(
    session: Path, cell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def spoil(rows: Rows) -> None:
        rows[4]["ft.l_foot.fz"] = cell

    change(session, spoil)
    code, text = refused(session, capsys)
    assert code == 3
    assert "poses.csv:6" in text
    assert "ft.l_foot.fz" in text


def test_poses_that_are_not_still_are_refused(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def move(rows: Rows) -> None:
        for row in rows:
            row["qd.l_knee"] = "0.0"
        rows[7]["qd.l_knee"] = "0.4"

    change(session, move)
    code, text = refused(session, capsys)
    assert code == 3
    assert "pose 8" in text


def test_a_robot_that_is_not_in_balance_is_refused(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def push(rows: Rows) -> None:
        rows[3]["ft.l_foot.fx"] = "150"

    change(session, push)
    code, text = refused(session, capsys)
    assert code == 3
    assert "pose 4" in text


def keep(*poses: int) -> Callable[[Rows], Rows]:
    return lambda rows: [row for row in rows if int(row["pose"]) in poses]


@pytest.mark.parametrize("poses", [(1,), (1, 2)])
def test_one_configuration_only_is_not_identifiable_and_says_what_to_add(
    session: Path, poses: tuple[int, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    change(session, keep(*poses))
    code = main(["solve", str(session)])
    out = capsys.readouterr().out
    assert code == 3
    assert "NOT IDENTIFIABLE" in out
    assert "one shape" in out


def test_cramer_alone_with_one_configuration_says_how_many_are_needed(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(session, keep(1, 2))
    code, text = refused(session, capsys, "--method", "cramer")
    assert code == 3
    assert "n + 1" in text


def test_a_tilt_too_small_is_measured_against_its_limit(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def same(rows: Rows) -> Rows:
        rows = keep(1, 2, 3, 4, 5, 6)(rows)
        for a, b in ((0, 1), (2, 3), (4, 5)):
            rows[b] = {**rows[a], "pose": rows[b]["pose"]}
        return rows

    change(session, same)
    code, text = refused(session, capsys, "--method", "cramer")
    assert code == 3
    assert "tilted too little" in text
    assert "limit 3 deg" in text


def test_a_rank_deficient_set_names_the_pose_that_would_help(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(session, keep(1, 2, 3, 4, 5, 6))
    assert main(["solve", str(session)]) == 0
    out = capsys.readouterr().out
    assert "rank 7 of 22" in out
    assert "moves l_hip_pitch by itself" in out
    assert "a pose on a slope would show it" in out


def test_an_unknown_key_is_refused_with_the_one_meant(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = session / "robot.yaml"
    path.write_text(path.read_text().replace("gravity:", "gravtiy:"))
    code, text = refused(session, capsys)
    assert code == 2
    assert "gravtiy" in text
    assert "gravity" in text
    assert "robot.yaml:" in text


def test_a_missing_urdf_is_named(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (session / "table1.urdf").unlink()
    code, text = refused(session, capsys)
    assert code == 2
    assert "table1.urdf" in text


def test_another_robot_s_urdf_is_refused(
    session: Path, recorded14: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copyfile(recorded14 / "biped14.urdf", session / "table1.urdf")
    code, text = refused(session, capsys)
    assert code in (2, 3)
    assert text.startswith("error:")


def test_a_folder_that_is_no_session_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = refused(tmp_path, capsys)
    assert code == 2
    assert str(tmp_path.name) in text


def test_an_engine_that_is_not_installed_is_named_with_the_line_to_type(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import comcal_sims.sources as sources

    monkeypatch.setattr(sources, "find_spec", lambda name: None)
    robot = table1.generate(tmp_path / "robot")
    code = main(["record", str(robot), "-s", str(tmp_path / "s"), "--source", "mujoco"])
    text = capsys.readouterr().err
    assert code == 6
    assert "pip install" in text
    assert not (tmp_path / "s" / "poses.csv").exists()


def test_a_session_is_never_solved_into_an_old_result(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(session), "--method", "lstsq"]) == 0
    first = (session / "results" / "001" / "result.json").read_bytes()
    assert main(["solve", str(session), "--method", "lstsq"]) == 0
    assert (session / "results" / "001" / "result.json").read_bytes() == first
    assert (session / "results" / "latest").resolve().name == "002"
