# SPDX-License-Identifier: Apache-2.0
"""``comcal diagnose`` and ``comcal report``: from a session to a name, a model and a page."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

from comcal.cli.main import main
from comcal.measure.plan_csv import read_plan, write_plan
from comcal.robot.changes_yaml import read_extension
from comcal.robot.description import load_robot
from comcal.workflow.sealed import truth_path
from comcal_sims.robots import table1

Run = Callable[..., tuple[int, str, str]]
SCHEMA = json.loads(
    files("comcal.report").joinpath("diagnosis.schema.json").read_text(encoding="utf-8")
)
FILES = {"diagnosis.json", "extended.yaml", "report.html", "used.csv"}


@dataclass(frozen=True)
class Diagnosed:
    """A session, what ``comcal diagnose`` printed about it, and the folder it wrote."""

    session: Path
    out: str
    folder: Path

    @property
    def content(self) -> dict:
        return json.loads((self.folder / "diagnosis.json").read_text("utf-8"))


def record(robot_yaml: Path, session: Path, *more: str) -> Path:
    arguments = ["record", str(robot_yaml), "-s", str(session), "--source", "builtin"]
    assert main([*arguments, "--seed", "5", *more]) == 0
    return session


def diagnose(session: Path, *more: str) -> Diagnosed:
    out = io.StringIO()
    with redirect_stdout(out):
        assert main(["diagnose", str(session), *more]) == 0
    return Diagnosed(session, out.getvalue(), (session / "results" / "latest").resolve())


@pytest.fixture(scope="module")
def robot_yaml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The robot of Table 1 with every other pose of its plan."""
    path = table1.generate(tmp_path_factory.mktemp("diagnose") / "robot")
    joints = load_robot(path).tree.joint_names
    poses = read_plan(path.with_name("plan.csv"), joints)[::2]
    path.with_name("plan.csv").unlink()
    write_plan(path.with_name("plan.csv"), poses, joints)
    return path


@pytest.fixture(scope="module")
def loaded(robot_yaml: Path) -> Diagnosed:
    """A robot with 2 kg at the waist that its URDF does not know."""
    hidden = "payload@waist:mass=2,com_x=0.05"
    session = record(robot_yaml, robot_yaml.parents[1] / "loaded", "--effect", hidden)
    # Nothing may depend on the answer: it is not even there.
    truth_path(session).unlink()
    return diagnose(session)


@pytest.fixture(scope="module")
def healthy(robot_yaml: Path) -> Diagnosed:
    """The same robot as its URDF says, solved, then diagnosed without two of its poses."""
    session = record(robot_yaml, robot_yaml.parents[1] / "healthy")
    assert main(["solve", str(session), "--no-currents", "--method", "lstsq"]) in (0, 5)
    return diagnose(session, "--drop", "1", "--drop", "3")


def test_a_hidden_body_is_named_and_measured(loaded) -> None:
    content = loaded.content
    jsonschema.validate(content, SCHEMA)
    assert content["verdict"] == "explained"
    (cause,) = content["causes"]
    assert (cause["effect"], cause["target"]) == ("payload", "waist")
    low, high = cause["parameters"]["mass"]["interval"]
    assert low < 2.0 < high
    assert high - low < 0.1
    assert cause["gain"]["interval"][0] > 0.0


def test_all_files_of_a_diagnosis_are_there(loaded) -> None:
    assert {file.name for file in loaded.folder.iterdir()} == FILES
    (known,) = read_extension(loaded.folder / "extended.yaml")
    assert (known.change.effect, known.change.target) == ("payload", "waist")
    assert known.sigma["mass"] > 0.0
    page = (loaded.folder / "report.html").read_text("utf-8")
    assert "EXPLAINED by payload@waist" in page
    assert "l_foot fz [N]" in page, "the readings themselves"


def test_report_begins_with_a_sentence_and_ends_in_the_verdict(loaded) -> None:
    lines = loaded.out.splitlines()
    assert lines[0] == loaded.content["sentence"]
    verdict = next(i for i, line in enumerate(lines) if line.startswith("Verdict: EXPLAINED by"))
    assert re.search(r"p = \S+ >= 0.0001$", lines[verdict + 1])
    assert all(line.startswith("wrote ") for line in lines[verdict + 2 :])
    assert max(map(len, lines[: verdict + 2])) <= 100
    assert "\x1b" not in loaded.out


def test_the_extended_model_has_nothing_wrong(loaded, tmp_path, run: Run) -> None:
    model = tmp_path / "model.yaml"
    shutil.copy(loaded.folder / "extended.yaml", model)
    code, out, _ = run("diagnose", loaded.session, "--model", model, "--json")
    content = json.loads(out)
    assert (code, content["verdict"]) == (0, "nothing_wrong")
    assert content["sha256"]["--model model.yaml"]
    latest = loaded.session / "results" / "latest" / "extended.yaml"
    assert read_extension(latest) == read_extension(model), "the model that was given goes on"


def test_a_healthy_robot_gets_no_cause(healthy) -> None:
    assert (healthy.content["verdict"], healthy.content["causes"]) == ("nothing_wrong", [])
    assert read_extension(healthy.folder / "extended.yaml") == ()
    assert "nothing is gained" in healthy.out


def test_dropped_poses_are_left_out_of_everything(healthy) -> None:
    with (healthy.session / "poses.csv").open(newline="", encoding="utf-8") as file:
        measured = {int(row["pose"]) for row in csv.DictReader(file)}
    assert {1, 3} < measured
    content = healthy.content
    assert {pose for trace in content["traces"] for pose in trace["poses"]} == measured - {1, 3}
    assert content["poses"] == len(measured) - 2


def test_nothing_is_overwritten_and_the_calibration_is_still_found(
    healthy, tmp_path, run: Run
) -> None:
    names = {path.name for path in (healthy.session / "results").iterdir()}
    assert names >= {"001", "002", "latest"}
    assert [path.name for path in (healthy.session / "results" / "001").iterdir()]
    assert healthy.folder.name == "002"
    code, out, _ = run("export", healthy.session, "--urdf", tmp_path / "new.urdf", "--dry-run")
    assert code == 0
    assert "+++ b/new.urdf" in out


def test_looking_for_other_causes_only_ends_undecided(loaded, run: Run) -> None:
    code, out, _ = run("diagnose", loaded.session, "--causes", "imu_mounting, hysteresis")
    assert code == 5
    assert "Verdict: UNEXPLAINED" in out
    assert "EXPLAINED by" not in out


def test_what_the_paper_published_is_named_against_its_own_model(healthy, tmp_path, run) -> None:
    model = tmp_path / "published.yaml"
    model.write_text(
        "format: comcal-extension/1\n"
        "effects: [{effect: internal_torque_term, parameters: {factor: {value: 1}}}]\n"
    )
    code, out, _ = run("diagnose", healthy.session, "--model", model, "--json")
    (cause,) = json.loads(out)["causes"]
    assert (code, cause["effect"]) == (0, "internal_torque_term")
    low, high = cause["parameters"]["factor"]["interval"]
    assert low < -1.0 < high
    (known,) = read_extension(healthy.session / "results" / "latest" / "extended.yaml")
    assert abs(known.change.number("factor")) < 0.1, "one entry: 1 of the model, -1 of the cause"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--causes", "paylod"), "did you mean 'payload'?"),
        (("--causes", "payload,sign_flip"), "leave out --causes"),
        (("--causes", "saturation"), "leave it out of --causes"),
        (("--drop", "977"), "there is no pose 977 to drop"),
        (("--rerun", "gazebo"), "give one of pybullet, mujoco, builtin"),
        (("--model", "nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_is_written(
    options, said, healthy, run: Run
) -> None:
    results = healthy.session / "results"
    before = sorted(results.iterdir())
    code, _, err = run("diagnose", healthy.session, *options)
    assert code == 2
    assert said in err
    assert sorted(results.iterdir()) == before


def test_a_file_that_is_no_model_is_refused(healthy, run: Run) -> None:
    robot_yaml = healthy.session / "robot.yaml"
    code, _, err = run("diagnose", healthy.session, "--model", robot_yaml)
    assert code == 2
    assert f"{robot_yaml}:1: is no extended.yaml" in err
    assert "got 'comcal-robot/1'" in err


def test_without_a_cause_there_is_nothing_to_run_again(healthy, run: Run) -> None:
    code, out, _ = run("diagnose", healthy.session, "--rerun", "builtin")
    assert code == 0
    assert "nothing to run again" in out


def test_a_model_of_another_robot_is_refused(healthy, tmp_path, run: Run) -> None:
    model = tmp_path / "other.yaml"
    model.write_text(
        "format: comcal-extension/1\n"
        "effects: [{effect: link_mass, target: waits, parameters: {mass: {value: 1}}}]\n"
    )
    code, _, err = run("diagnose", healthy.session, "--model", model)
    assert code == 2
    assert "did you mean 'waist'?" in err


def test_readings_that_cannot_be_true_are_diagnosed_all_the_same(
    healthy, tmp_path, run: Run
) -> None:
    session = tmp_path / "s"
    session.mkdir()
    for name in ("robot.yaml", "table1.urdf"):
        shutil.copy(healthy.session / name, session)
    with (healthy.session / "poses.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["ft.l_foot.fz"] = str(-float(row["ft.l_foot.fz"]))
    with (session / "poses.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    assert run("solve", session)[0] == 3
    _, out, _ = run("diagnose", session)
    assert "note: cannot be true:" in out
    assert re.search(r"(sign_flip|frame_handedness)@l_foot", out)


def test_one_page_of_a_session_and_one_of_several(healthy, loaded, tmp_path, run: Run) -> None:
    one, both = tmp_path / "one.html", tmp_path / "both.html"
    assert run("report", healthy.session, "-o", one)[0] == 0
    assert "calibration: " in one.read_text("utf-8"), "what solve found is beside it"
    code, out, _ = run("report", healthy.session, loaded.session, "-o", both, "--json")
    assert (code, json.loads(out)) == (0, {"report": str(both)})
    assert "2 sessions side by side" in both.read_text("utf-8")
    code, _, err = run("report", loaded.session, "-o", one)
    assert code == 2
    assert "nothing is ever overwritten" in err


def test_a_session_without_a_diagnosis_has_no_page(robot_yaml, tmp_path, run: Run) -> None:
    session = record(robot_yaml, tmp_path / "new")
    code, _, err = run("report", session, "-o", tmp_path / "page.html")
    assert code == 2
    assert "comcal diagnose" in err
