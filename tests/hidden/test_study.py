# SPDX-License-Identifier: Apache-2.0
"""The parts of ``tests/studies/hidden.py``: sizes, judgements, rates, and a folder that resumes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from comcal.diagnose.places import FAULTS
from comcal.errors import UsageError
from comcal.robot.changes import Change
from comcal.robot.changes_text import change_text, parse_change
from comcal.robot.healthy import draw_healthy

KEPT = sorted(
    study.parent.name
    for study in (Path(__file__).parent.parent / "studies").glob("rates*/study.json")
)
"""Folders of trials that stand in the README."""


@pytest.fixture(scope="module")
def ruler(study: SimpleNamespace) -> Any:
    return study.ruler.ruler("upright")


def test_healthy_robots_are_as_far_off_as_the_covariance_says(
    study: SimpleNamespace, ruler: Any
) -> None:
    """The covariance comes from differences of simulated robots, one spread at a time."""
    squares = []
    for seed in range(4):
        changes = draw_healthy(ruler.stage.robot, np.random.default_rng([1, seed]))
        table = study.world.hidden_table(ruler.stage, changes, 25, engine="builtin", seed=seed)
        rows = study.columns.rows_of(ruler.stage, table)
        squares.append(np.mean(ruler.whitened_of(rows.values, tuple(table.pose)) ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_size_grows_with_the_effect_and_separation_is_less(
    study: SimpleNamespace, ruler: Any
) -> None:
    pair = ("payload", "l_arm")
    sizes = [
        ruler.size(pair, (Change(*pair, {"mass": mass, "com_z": -0.3}),)) for mass in (0.5, 1.0)
    ]
    assert sizes[1].s == pytest.approx(2.0 * sizes[0].s, rel=1e-6)
    assert all(0.0 < size.d < size.s for size in sizes)


def test_an_effect_that_looks_like_another_is_not_separated(
    study: SimpleNamespace, ruler: Any
) -> None:
    """An arm whose joint is off hangs as one does whose CoM is."""
    pair = ("joint_offset", "l_shoulder")
    size = ruler.size(pair, (Change(*pair, {"offset": 0.05}),))
    assert size.d < 0.1 * size.s
    assert size.rival[1] == "l_arm"


def test_a_special_case_has_the_general_effect_for_no_rival(
    study: SimpleNamespace, ruler: Any
) -> None:
    scenario = study.scenario.scenario()
    assert scenario.general(("link_mass", "torso")) == {("payload", "torso")}
    assert scenario.general(("payload", "torso")) == frozenset()


@pytest.mark.parametrize(
    "pair", [("link_com", "torso"), ("ft_crosstalk", "l_foot"), ("tether", "pelvis")]
)
def test_draws_have_the_size_that_was_wanted(
    study: SimpleNamespace, ruler: Any, pair: tuple[str, str]
) -> None:
    change, x = study.draw.of_size(ruler, pair, 20.0, np.random.default_rng(1))
    assert np.linalg.norm(x) == pytest.approx(20.0)
    assert ruler.size(pair, (change,)).s == pytest.approx(20.0, rel=0.05)


SAME = (
    ("channel_swap@l_foot:channels=fx+fy", "channel_swap@l_foot:channels=fy+fx"),
    ("frame_handedness@l_foot:axis=x", "sign_flip@l_foot:channels=fx+tx"),
    ("left_right_swap@l_foot:other=r_foot", "left_right_swap@r_foot:other=l_foot"),
    ("unit_error@imu:channels=ax,factor=0.102", "unit_error@imu:channels=ax,factor=0.101"),
    ("payload@torso:mass=5", "payload@torso:mass=4"),
    ("external_contact@l_arm:force_x=1,poses=3", "external_contact@l_arm:force_x=2,poses=3"),
)
NOT_THE_SAME = (
    ("unit_error@l_knee:channels=i,factor=1000", "unit_error@l_knee:channels=i,factor=100"),
    ("sign_flip@l_knee:channels=i", "sign_flip@r_knee:channels=i"),
    ("sign_flip@l_knee:channels=i", "torque_constant@l_knee:relative=-0.9"),
    ("payload@torso:mass=5", "link_mass@torso:mass=5"),
    ("external_contact@l_arm:force_x=1,poses=3", "external_contact@l_arm:force_x=2,poses=4"),
    ("external_contact@l_arm:force_x=1", "external_contact@l_arm:force_x=1,poses=4"),
    ("external_contact@l_arm:force_x=1,poses=4", "external_contact@l_arm:force_x=1"),
)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [*((a, b, True) for a, b in SAME), *((a, b, False) for a, b in NOT_THE_SAME)],
)
def test_changes_are_the_same_if_they_do_the_same(
    study: SimpleNamespace, one: str, other: str, same: bool
) -> None:
    assert study.judge.same_change(parse_change(one), parse_change(other)) is same


def test_a_hand_in_a_pose_that_was_never_recorded_need_not_be_found(study: SimpleNamespace) -> None:
    first, second = (
        parse_change(f"external_contact@l_arm:force_x=20,poses={pose}") for pose in (3, 4)
    )
    both = parse_change("external_contact@l_arm:force_x=20,poses=3+4")
    everywhere = parse_change("external_contact@l_arm:force_x=20")
    assert study.judge.as_recorded(first, (1, 2, 4)) is None
    assert study.judge.as_recorded(both, (1, 2, 4)) == second
    assert study.judge.as_recorded(everywhere, (1, 2)) == everywhere


@pytest.mark.parametrize("all_fell", [False, True])
def test_poses_in_which_the_robot_fell_are_not_judged(
    study: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, all_fell: bool
) -> None:
    """Pose by pose: what was recorded and found is right, whatever was to be found besides."""
    touched = tuple(
        parse_change(f"external_contact@l_arm:force_x=20,point_z=-0.6,poses={pose}")
        for pose in (3, 4)
    )
    case = study.lines.Case("upright", "builtin", touched)
    monkeypatch.setattr(study.trial, "LINES", {"contact": lambda rng, engine: case})

    fell = (3, 4) if all_fell else (4,)

    def falls(stage: Any, *arguments: Any, **more: Any) -> Any:
        stood = tuple(pose for pose in stage.poses if pose.pose not in fell)
        return recorded(replace(stage, poses=stood), *arguments, **more)

    recorded = study.world.hidden_table
    monkeypatch.setattr(study.trial, "hidden_table", falls)
    found = study.trial.run_trial("contact", 3, 0)
    if all_fell:
        assert "refused" in found
        assert not study.rates.counts(found)
        return
    assert [entry["change"] for entry in found["truth"]] == [change_text(touched[0])]
    assert rate(study, [found], "pose by pose").hits == 1


def test_the_truth_of_a_parameter_has_the_healthy_part_in_it(study: SimpleNamespace) -> None:
    springs = [Change("joint_compliance", "l_knee", {"stiffness": k}) for k in (1e4, 1e5)]
    assert study.judge.total("stiffness", springs[0], springs) == pytest.approx(1 / 1.1e-4)
    masses = [Change("link_mass", "torso", {"mass": m}) for m in (2.0, -0.1)]
    assert study.judge.total("mass", masses[0], masses) == pytest.approx(1.9)
    scales = [Change("torque_constant", "l_knee", {"relative": r}) for r in (0.4, -0.01)]
    assert study.judge.total("relative", scales[0], scales) == pytest.approx(0.386)
    touches = [Change("external_contact", "l_arm", {"force_x": x, "poses": (x,)}) for x in (3, 4)]
    assert study.judge.total("force_x", touches[0], touches) == pytest.approx(3.0)


def record(line: str, verdict: str, *named: str, true: str = "payload@torso", **more: Any) -> Any:
    found = [name for name in named if name == true]
    sizes = {"s": 20.0, "d": 12.0, "rival": "payload@pelvis"}
    truth = [{"name": true, "change": true, "realisation": "engine", "found": found, **sizes}]
    causes = [
        {"name": n, "size": 20.0, "gain": [0.1, 0.2], "outside": [], "values": [], "change": n}
        for n in named
    ]
    return {
        "line": line,
        "index": 0,
        "engine": "pybullet",
        "truth": [] if line == "healthy" else truth,
        "verdict": verdict,
        "named": causes,
        "groups": [],
        "findings": [],
        "place": None,
        "p": [0.1, 0.1],
        "cpu": 1.0,
        **more,
    }


def rate(study: SimpleNamespace, records: list[Any], what: str) -> Any:
    return next(r for r in study.rates.rates(records) if r.criterion.what.endswith(what))


def test_rates_count_what_they_say(study: SimpleNamespace) -> None:
    right = record("single", "explained", "payload@torso")
    with_more = record("single", "explained", "payload@torso", "ft_bias@l_foot")
    wrong = record("single", "explained", "ft_bias@l_foot")
    distrusted = record("single", "unexplained", "payload@torso")
    refused = record("single", "", refused="the robot falls")
    crashed = record("single", "", crashed="KeyError")
    records = [right, with_more, wrong, distrusted, refused, crashed]
    named, alone = rate(study, records, "8: named"), rate(study, records, "alone and explained")
    assert (named.hits, named.n, alone.hits, alone.n) == (2, 5, 1, 5)
    assert not named.is_met
    lines = "\n".join(study.table.table(records))
    assert "missed" in lines
    assert "payload" in "\n".join(study.table.confusion(records))
    assert "crashed" in "\n".join(study.table.failures(records))


def test_what_nothing_is_asked_of_is_no_failure(study: SimpleNamespace) -> None:
    told = record("five_kg_no_currents", "explained", "payload@torso")
    assert rate(study, [told], "no currents: link").hits == 1
    assert not list(study.table.failures([told]))


@pytest.mark.parametrize(("false", "n", "met"), [(0, 10, True), (2, 200, True), (5, 200, False)])
def test_a_rate_is_met_if_its_interval_reaches_the_figure(
    study: SimpleNamespace, false: int, n: int, met: bool
) -> None:
    records = [record("healthy", "explained", "ft_bias@l_foot")] * false
    records += [record("healthy", "nothing_wrong")] * (n - false)
    assert rate(study, records, "a cause").is_met is met


def test_the_truth_in_the_set_counts_for_close_effects(study: SimpleNamespace) -> None:
    groups = [["link_mass@torso", "payload@torso"]]
    close = record("close", "ambiguous", "link_mass@torso", groups=groups)
    close["truth"][0]["d"] = 3.0
    assert rate(study, [close], "in the set, or alone").hits == 1
    close["groups"] = [["link_mass@torso", "payload@pelvis"]]
    assert rate(study, [close], "in the set, or alone").hits == 0


@pytest.mark.parametrize(
    ("place", "cause", "there", "named"),
    [
        (["sensor", "l_foot", ""], "ft_gain@l_foot", True, True),
        (["sensor", "r_foot", ""], "ft_gain@r_foot", False, False),
        (["encoder", "l_foot", ""], "payload@l_foot", False, False),
    ],
)
def test_what_has_no_name_is_looked_for_where_it_acts(
    study: SimpleNamespace, place: list[str], cause: str, there: bool, named: bool
) -> None:
    hidden = "unknown@l_foot:function=curvature,amplitude=3e-05"
    said = record("unknown", "unexplained", true=hidden, place=place)
    blamed = record("unknown", "explained", cause, true=hidden)
    assert rate(study, [said], "place said is right").hits == there
    assert rate(study, [said], "unexplained or its place").hits == 1
    assert rate(study, [blamed], "unexplained or its place").hits == named


def test_places_are_called_as_the_diagnosis_calls_them(study: SimpleNamespace) -> None:
    assert set(study.judge.PLACES.values()) <= {*FAULTS, "sensor"}
    assert study.judge.is_place("imu_curvature", "imu", ["IMU", "", ""])


def test_trials_of_all_lines_come_early(study: SimpleNamespace) -> None:
    order = list(study.script.in_turn({"single": 300, "healthy": 1000, "two": 300}))
    assert len(order) == len(set(order)) == 1600
    assert {line for line, _ in order[:8]} == {"single", "healthy", "two"}


def test_a_folder_goes_on_after_a_kill_and_refuses_other_code(
    study: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = study.store.StudyFolder(tmp_path, None, 77)
    done = {"line": "single", "master": 77, "index": 0}
    with first.locked():
        first.append([done])
    with (tmp_path / "trials.jsonl").open("a") as stream:
        stream.write('{"line": "single", "mas')  # killed here
    again = study.store.StudyFolder(tmp_path, None, 78)
    assert again.seed == 77
    with again.locked():
        assert set(again.finished()) == {("single", 77, 0)}
        again.append([{**done, "index": 1}])
    kept = again.finished()
    assert set(kept) == {("single", 77, 0), ("single", 77, 1)}
    assert kept["single", 77, 0]["code"] == study.columns.code_hash()
    monkeypatch.setattr(study.store, "code_hash", lambda: "other")
    with pytest.raises(UsageError, match="another code"):
        study.store.StudyFolder(tmp_path, None, 79)


@pytest.mark.parametrize("name", KEPT)
def test_the_table_in_the_readme_is_that_of_the_trials_that_are_kept(
    study: SimpleNamespace, root: Path, name: str
) -> None:
    folder = root / "tests" / "studies" / name
    records = study.store.kept_trials(folder)
    origin = json.loads((folder / "study.json").read_text("utf-8"))
    readme = (root / "README.md").read_text("utf-8")
    assert "\n".join(study.table.markdown(records)) in readme
    assert str(origin["seed"]) in readme
    assert origin["commit"][:7] in readme
    assert {record["master"] for record in records} == {origin["seed"]}
    assert {record["code"] for record in records} == {origin["code"]}
