# SPDX-License-Identifier: Apache-2.0
"""``comcal solve`` and ``comcal demo``: the report, result.json against its schema, exit codes."""

from __future__ import annotations

import json
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import jsonschema
import pytest

from comcal.cli.main import main
from comcal.workflow import demo
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
    import shutil

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


@pytest.mark.parametrize(
    ("missing", "engine"),
    [(set(), "pybullet"), ({"pybullet"}, "mujoco"), ({"pybullet", "mujoco"}, "builtin")],
)
def test_the_demo_takes_the_best_engine_and_says_why(
    missing: set[str], engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "find_spec", lambda name: None if name in missing else object())
    choice = demo.choose_engine()
    assert choice.source == engine
    assert choice.why
    assert all(name in choice.why for name in missing if name != "mujoco")


def test_the_demo_ends_in_a_verdict_and_overwrites_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("comcal-demo", "comcal-demo-2"):
        assert main(["demo", "--source", "builtin", "--seed", "2", "-o", str(tmp_path)]) == 0
        out = capsys.readouterr().out
        assert out.startswith("engine: builtin")
        assert "Verdict: PASSED" in out
        assert "next: comcal solve" in out
        assert (tmp_path / folder / "session" / "results" / "latest" / "result.json").is_file()


@pytest.mark.engine
@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_the_demo_runs_in_every_engine(
    engine: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if find_spec(engine) is None:
        pytest.skip(f"{engine} is not installed")
    code = main(["demo", "--source", engine, "--seed", "3", "-o", str(tmp_path), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert code == 0
    assert result["verdict"] == "passed"
