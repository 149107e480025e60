# SPDX-License-Identifier: Apache-2.0
"""``comcal solve``: the report, result.json against its schema, exit codes."""

from __future__ import annotations

import json
import shutil
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

from comcal.cli.main import main
from comcal_sims.robots import biped14, table1

SCHEMA = json.loads(files("comcal.report").joinpath("result.schema.json").read_text("utf-8"))


def record(robot: Path, session: Path, *options: str) -> None:
    arguments = ["record", str(robot), "-s", str(session), "--source", "builtin"]
    assert main([*arguments, "--seed", "7", *options]) == 0


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("noisy")
    record(table1.generate(folder / "robot"), folder / "s")
    return folder / "s"


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exact")
    record(table1.generate(folder / "robot", r_b=0.01, r_c=-0.02), folder / "s", "--no-noise")
    return folder / "s"


def result_of(session: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict:
    capsys.readouterr()
    code = main(["solve", str(session), "--json", *options])
    assert code in (0, 3)
    printed = json.loads(capsys.readouterr().out)
    latest = json.loads((session / "results" / "latest" / "result.json").read_text("utf-8"))
    assert printed == latest
    return printed


@pytest.mark.parametrize("method", ["both", "cramer", "lstsq"])
def test_the_result_keeps_its_contract(
    method: str, noisy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = result_of(noisy, capsys, "--method", method)
    jsonschema.validate(result, SCHEMA)
    assert set(result["sha256"]) == {"robot.yaml", "poses.csv", "table1.urdf"}


def test_the_json_holds_the_truth_of_a_noise_free_session(
    exact: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = result_of(exact, capsys)
    jsonschema.validate(result, SCHEMA)
    assert result["mass"]["value"] == pytest.approx(18.6, abs=1e-6)
    best = result["cramer"]["choices"][0]
    assert best["l"] == pytest.approx([0.2, 0.32208589], abs=1e-6)
    assert best["r"] == pytest.approx([0.01, 2 * 1.16 * -0.02 / 3.26], abs=1e-6)
    shin = next(link for link in result["links"] if link["link"] == "l_shin")
    # URDF frame at the knee, z up: l_b = 200 mm above the ankle is 200 mm below the knee.
    assert shin["com"][2] == pytest.approx(-0.2, abs=1e-6)
    assert shin["identifiable"] == [False, False, True]
    assert shin["source"][2] == "measured"


def test_the_report_ends_in_one_verdict_with_limits_beside_it(
    noisy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(noisy)]) == 0
    out = capsys.readouterr().out
    assert out.count("Verdict:") == 1
    assert "held-out CoM error, upper 95 %" in out
    assert "<= 5 mm" in out
    for heading in ("Line of gravity", "paper's route", "Cramer's rule", "All data", "Both routes"):
        assert heading in out
    assert "the two routes agree" in out
    assert all(len(line) <= 100 for line in out.splitlines() if not line.startswith("wrote"))


def test_a_limit_that_is_not_met_is_exit_5(
    noisy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = Path(shutil.copytree(noisy, tmp_path / "s", symlinks=True))
    robot = session / "robot.yaml"
    robot.write_text(robot.read_text().replace("com_error: 5 mm", "com_error: 0.01 mm"))
    assert main(["solve", str(session)]) == 5
    assert "Verdict: FAILED" in capsys.readouterr().out


def test_as_published_stands_beside_the_corrected_answer(
    exact: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(exact), "--as-published"]) == 0
    lines = capsys.readouterr().out.splitlines()
    urdf = next(line for line in lines if line.startswith("URDF"))
    corrected = next(line for line in lines if line.startswith("corrected"))
    assert urdf.split()[-4:] == corrected.split()[-4:]
    published = [line for line in lines if line.startswith("as published, all together")]
    assert len(published) == 2
    assert all(line.split()[-4:] != urdf.split()[-4:] for line in published)


@pytest.mark.parametrize("option", ["--as-published", "--masses"])
def test_what_json_cannot_hold_is_refused_instead_of_ignored(
    option: str, noisy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(noisy), "--json", option]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "leave out --json" in err


@pytest.fixture
def handmade(noisy: Path, tmp_path: Path) -> Path:
    """What any logger can write: robot.yaml, the URDF and poses.csv, without the last line end."""
    folder = tmp_path / "handmade"
    folder.mkdir()
    for name in ("robot.yaml", "table1.urdf"):
        shutil.copy(noisy / name, folder)
    (folder / "poses.csv").write_bytes((noisy / "poses.csv").read_bytes().rstrip(b"\n"))
    return folder


def test_robot_urdf_and_poses_are_all_that_is_needed(
    handmade: Path, noisy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    by_hand, recorded = (result_of(folder, capsys) for folder in (handmade, noisy))
    assert [c["pose"] for c in by_hand["coefficients"]] == list(range(1, 26))
    for key in ("mass", "links", "total_com", "verdict"):
        assert by_hand[key] == recorded[key]
    assert {path.name for path in handmade.iterdir()} == {
        "robot.yaml", "table1.urdf", "poses.csv", "results"
    }  # fmt: skip


def test_a_session_that_lost_its_session_yaml_does_not_pass_for_one_made_by_hand(
    noisy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = Path(shutil.copytree(noisy, tmp_path / "s", symlinks=True))
    (session / "session.yaml").unlink()
    assert main(["solve", str(session)]) == 2
    assert "session.yaml is gone" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        (["poses.csv"], "no poses.csv either"),
        (["robot.yaml", "poses.csv"], "no robot.yaml and poses.csv either"),
        (["table1.urdf"], "table1.urdf"),
    ],
)
def test_what_a_handmade_folder_lacks_is_named(
    lost: list[str], words: str, handmade: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in lost:
        (handmade / name).unlink()
    assert main(["solve", str(handmade)]) == 2
    assert words in capsys.readouterr().err
    assert not (handmade / "results").exists()


def test_a_folder_that_is_not_there_is_called_that(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(tmp_path / "mondya")]) == 2
    assert "there is no such folder" in capsys.readouterr().err


def test_a_chain_gets_result_files_and_the_exit_code_of_its_verdict(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, session = root / "tests" / "golden" / "cotton2009", tmp_path / "s"
    typed = ["import", str(log / "table1.csv"), "--map", str(log / "map.yaml"), "-s", str(session)]
    assert main(typed) == 0
    # Without the many readings of conventions.yaml this takes a moment instead of seconds.
    (session / "conventions.yaml").unlink()
    capsys.readouterr()
    held_out = "4,7,8,14,15"  # leaves fourteen poses for thirteen unknowns
    assert main(["solve", str(session), "--held-out", held_out, "--json"]) == 3
    printed = json.loads(capsys.readouterr().out)
    latest = session / "results" / "latest"
    assert json.loads((latest / "result.json").read_text("utf-8")) == printed
    assert printed["verdict"] == "not_identifiable"
    assert set(printed["sha256"]) == {"robot.yaml", "poses.csv"}
    assert main(["solve", str(session), "--drop", "3"]) == 0
    out = capsys.readouterr().out
    assert f"wrote {session / 'results' / '002' / 'result.json'}" in out
    for option in ("--masses", "--as-published", "--method=lstsq"):
        assert main(["solve", str(session), option]) == 2


def test_dropped_poses_are_left_out(noisy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = result_of(noisy, capsys, "--drop", "3", "--drop", "9")
    assert {c["pose"] for c in result["coefficients"]} == set(range(1, 26)) - {3, 9}


def test_a_pose_that_is_not_there_cannot_be_dropped(
    noisy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(noisy), "--drop", "99"]) == 2
    assert "no pose 99" in capsys.readouterr().err


def test_the_biped_with_fourteen_joints_is_solved_without_cramer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(biped14.generate(tmp_path / "robot"), tmp_path / "s")
    result = result_of(tmp_path / "s", capsys)
    jsonschema.validate(result, SCHEMA)
    assert result["rank"] == 27
    assert result["cramer"]["reason"]
    assert result["verdict"] == "passed"
