# SPDX-License-Identifier: Apache-2.0
"""``comcal demo``: a fault is hidden and named; the truth is read when the verdict is on disk."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.diagnose.diagnosis import Cause, Diagnosis, Estimate, Misfit, Rival, Verdict
from comcal.measure.plan import NONE
from comcal.measure.plan_csv import read_plan
from comcal.measure.session import Session
from comcal.report.demo_truth import hidden_line, judge
from comcal.robot.changes import Change, check_changes
from comcal.robot.description import load_robot
from comcal.workflow import demo
from comcal.workflow.demo_fault import KINDS, draw_fault
from comcal.workflow.sealed import truth_path
from comcal_sims.robots import biped14, table1

LINES = 45
PAYLOAD_TYPED = "payload@l_thigh:mass=1,com_x=0.1"


@dataclass(frozen=True)
class Told:
    """A demo in the built-in world, its truth kept out of reach until the story was told."""

    code: int
    out: str
    folder: Path


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Told:
    parent = tmp_path_factory.mktemp("demo")
    (parent / "comcal-demo").mkdir()
    tell_story = demo.tell_story

    def without_truth(session: Session, *more: Any) -> Any:
        truth = truth_path(session.directory)
        away = truth.rename(parent / "elsewhere")
        story = tell_story(session, *more)
        assert session.newest_result("diagnosis.json") is not None
        away.rename(truth)
        return story

    text = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(text):
        patch.setattr(demo, "tell_story", without_truth)
        code = main(["demo", "--source", "builtin", "--seed", "2", "-o", str(parent)])
    return Told(code, text.getvalue(), parent / "comcal-demo-2")


def test_the_hidden_fault_is_found_without_the_truth(told: Told) -> None:
    assert told.code == 0
    assert "Verdict: EXPLAINED by ft_mounting@l_foot" in told.out
    last = told.out[told.out.index("hidden was") :]
    assert last.startswith("hidden was: ft_mounting@l_foot: ")
    assert "; RIGHT, " in last.replace("\n  ", " ")


def test_the_story_is_short_and_names_its_engine_first(told: Told) -> None:
    lines = told.out.splitlines()
    assert lines[0] == "engine: builtin, because it was asked for"
    assert lines[1].endswith("seed 2")
    assert len(lines) <= LINES
    for word in ("Predicted by statics", "Physics run again by builtin", "Calibrated with"):
        assert word in told.out


def test_the_session_is_like_any_other_and_does_not_know_what_it_hides(told: Told) -> None:
    session = told.folder / "session"
    assert "sealed" in (session / "session.yaml").read_text("utf-8")
    assert "ft_mounting" in truth_path(session).read_text("utf-8")
    texts = [session / "session.yaml", session / "robot.yaml", session / "poses.csv"]
    assert not [path for path in texts if "ft_mounting" in path.read_text("utf-8")]
    assert [path.name for path in sorted((session / "results").glob("0*"))] == ["001", "002", "003"]


def test_what_was_not_fitted_took_no_part(told: Told) -> None:
    """Poses held out are in the plan and in the session, and stand; no calibration used them."""
    joints = load_robot(told.folder / "robot" / "robot.yaml").tree.joint_names
    poses = read_plan(told.folder / "plan.csv", joints)
    fresh = demo.held_out(poses)
    assert len(poses) == demo.POSES
    assert len(fresh) >= 5
    assert {pose.pose for pose in poses if pose.support == NONE}.isdisjoint(fresh)
    result = json.loads((told.folder / "session/results/003/result.json").read_text("utf-8"))
    assert {entry["pose"] for entry in result["coefficients"]}.isdisjoint(fresh)
    assert result["held_out"]["poses"] == len(fresh)


def run_json(
    capsys: pytest.CaptureFixture[str], parent: Path, *options: str
) -> tuple[int, Mapping[str, Any]]:
    arguments = ["demo", "--robot", "table1", "--seed", "3", "--json", "-o", str(parent)]
    code = main([*arguments, *options])
    return code, json.loads(capsys.readouterr().out)


def test_nothing_is_found_where_nothing_is_hidden(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, found = run_json(capsys, tmp_path, "--source", "builtin", "--effect", "none")
    assert (code, found["right"], found["verdict"]) == (0, True, "nothing_wrong")
    assert found["hidden"] == []
    assert found["calibration"]["nominal"]["verdict"] == "passed"
    assert found["rerun"] is None


def test_what_is_too_small_to_be_seen_is_not_called_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ("--effect", "ft_bias@l_foot:fx=0.001")
    code, found = run_json(capsys, tmp_path, "--source", "builtin", *small)
    assert (code, found["right"], found["verdict"]) == (5, False, "nothing_wrong")


@pytest.mark.engine
@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_the_demo_runs_in_every_engine(
    engine: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if find_spec(engine) is None:
        pytest.skip(f"{engine} is not installed")
    code, found = run_json(capsys, tmp_path, "--source", engine, "--effect", PAYLOAD_TYPED)
    assert (code, found["right"], found["engine"]) == (0, True, engine)
    force = next(m for m in found["rerun"]["measures"] if m["what"] == "total foot force")
    assert force["extended"]["rms"] < 0.2 * force["given"]["rms"]


@pytest.mark.parametrize(
    ("missing", "engine"),
    [(set(), "pybullet"), ({"pybullet"}, "mujoco"), ({"pybullet", "mujoco"}, "builtin")],
)
def test_the_demo_takes_the_best_engine_and_says_why(
    missing: set[str], engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def find_spec(name: str) -> object:
        return None if name in missing else object()

    monkeypatch.setattr(demo, "find_spec", find_spec)
    choice = demo.choose_engine()
    assert choice.source == engine
    assert choice.why
    assert all(name in choice.why for name in missing if name != "mujoco")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--source", "nothing"), "there is no source 'nothing'"),
        (("--source", "builtin", "--effect", "payload@nose:mass=1"), "nose"),
        (("--effect", "none", "--effect", PAYLOAD_TYPED), "none hides nothing"),
    ],
)
def test_a_demo_that_cannot_begin_leaves_nothing_behind(
    options: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", *options, "-o", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("robot", [biped14, table1], ids=["biped14", "table1"])
def test_every_fault_that_is_drawn_can_be_hidden(robot: Any, tmp_path: Path) -> None:
    described = load_robot(robot.generate(tmp_path))
    drawn = [draw_fault(described, np.random.default_rng(seed)) for seed in range(300)]
    for change in drawn:
        check_changes((change,), described)
    kinds = {change.effect for change in drawn}
    without = {"imu_mounting", "sole_compliance"}  # neither an IMU, nor legs with roll joints
    assert kinds == set(KINDS) - (without if robot is table1 else set())


PAYLOAD = Change("payload", "torso", {"mass": 3.0, "com_x": 0.1})
OTHER = Change("ft_bias", "l_foot", {"fz": 8.0})


def cause(change: Change, mass: float = 3.0) -> Cause:
    estimate = Estimate(mass, 0.1, (mass - 0.2, mass + 0.2), "kg")
    return Cause(change, {"mass": estimate}, log_odds=50.0, size=40.0)


def diagnosis(verdict: Verdict, *causes: Cause, group: tuple[Rival, ...] = ()) -> Diagnosis:
    return Diagnosis(
        verdict=verdict,
        sentence="",
        causes=causes,
        groups=(group,) if group else (),
        findings=(),
        place=None,
        misfit=Misfit(1.0, 1, 0.5, 1.0, 0.5),
        would_decide=(),
        channels=(),
    )


def test_right_is_what_names_all_that_was_hidden_and_nothing_else() -> None:
    right = judge((PAYLOAD,), diagnosis(Verdict.EXPLAINED, cause(PAYLOAD, 3.1)))
    assert right.is_right
    assert hidden_line(right) == (
        "hidden was: payload@torso: mass 3 kg, com_x 100 mm; RIGHT, 1 of 1 values in their 95 % "
        "interval"
    )
    for hidden, causes in (
        ((PAYLOAD,), (cause(OTHER),)),
        ((PAYLOAD,), (cause(PAYLOAD), cause(OTHER))),
        ((PAYLOAD, OTHER), (cause(PAYLOAD),)),
        ((), (cause(PAYLOAD),)),
    ):
        wrong = judge(hidden, diagnosis(Verdict.EXPLAINED, *causes))
        assert not wrong.is_right
        assert "WRONG" in hidden_line(wrong)


def test_a_value_outside_its_interval_is_counted() -> None:
    off = judge((PAYLOAD,), diagnosis(Verdict.EXPLAINED, cause(PAYLOAD, 4.0)))
    assert (off.is_right, off.inside, off.values) == (True, 0, 1)


def test_one_of_several_is_not_yet_right() -> None:
    group = (Rival("ft_bias", "l_foot", 0.0, 0.0), Rival("payload", "torso", 1.0, 0.01))
    among = judge((PAYLOAD,), diagnosis(Verdict.AMBIGUOUS, cause(OTHER), group=group))
    assert not among.is_right
    assert "NOT DECIDED" in hidden_line(among)
