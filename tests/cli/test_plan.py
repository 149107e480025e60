# SPDX-License-Identifier: Apache-2.0
"""``comcal plan``: a plan that records and solves, a forecast that says so, mistakes named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.measure.plan_csv import read_plan
from comcal.robot.description import load_robot


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("biped14")
    assert main(["generate", "biped14", "-o", str(folder)]) == 0
    return folder / "robot.yaml"


def plan(robot: Path, output: Path, *more: str) -> int:
    words = ["plan", str(robot), "-o", str(output), "--support", "left,right", "--seed", "3"]
    return main([*words, *more])


def test_planned_poses_record_and_solve_as_promised(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, session = tmp_path / "plan.csv", tmp_path / "session"
    assert plan(robot, path, "-n", "24", "--json") == 0
    promised = json.loads(capsys.readouterr().out)
    assert promised["format"] == "comcal-plan/1"
    poses = read_plan(path, load_robot(robot).tree.joint_names)
    assert len(poses) == 24 == sum(promised["poses"].values())
    record = ["record", str(robot), "-s", str(session), "--source", "builtin", "--seed", "1"]
    assert main([*record, "--poses", str(path)]) == 0
    capsys.readouterr()
    assert main(["solve", str(session), "--json"]) in (0, 5)
    result = json.loads(capsys.readouterr().out)
    assert result["rank"] == promised["predicted"]["rank"]
    cov = {link["link"]: link["cov"] for link in result["links"]}
    ratios = [
        np.sqrt(cov[link["link"]][i][i]) / sigma
        for link in promised["predicted"]["links"]
        for i, sigma in enumerate(link["sigma"])
        if sigma is not None and cov[link["link"]][i][i] is not None
    ]
    # Most of it is the encoders' scatter from visit to visit, which robot.yaml states.
    assert 0.8 < np.median(ratios) < 1.2
    assert np.std(ratios) < 0.35 * np.median(ratios)

    more = tmp_path / "more.csv"
    assert plan(robot, more, "-n", "5", "--improve", str(session)) == 0
    said = capsys.readouterr().out
    assert "5 more poses" in said
    assert " -> " in said
    ids = [p.pose for p in read_plan(more, load_robot(robot).tree.joint_names)]
    assert min(ids) > max(p.pose for p in poses)


def test_same_seed_writes_the_same_file_and_never_over_another(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    assert plan(robot, one, "-n", "3", "--support", "left") == 0
    said = capsys.readouterr().out
    assert "seed 3" in said
    assert "not checked" in said
    assert plan(robot, two, "-n", "3", "--support", "left") == 0
    assert one.read_bytes() == two.read_bytes()
    assert plan(robot, one) == 2
    assert "not overwritten" in capsys.readouterr().err


def test_supports_the_robot_cannot_do_are_left_out_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without roll joints nobody stands on one foot."""
    assert main(["generate", "table1", "-o", str(tmp_path)]) == 0
    (tmp_path / "plan.csv").unlink()
    words = ["plan", str(tmp_path / "robot.yaml"), "-n", "2", "--seed", "1"]
    assert main([*words, "-o", str(tmp_path / "plan.csv")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "no pose was found that stands in support 'left': it is left out" in said
    assert "plan more with -n" in said


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--support", "middle"], 2, "feet of this robot"),
        (["--support", "none"], 2, "hanging"),
        (["--margin", "200"], 2, "smaller --margin"),
        (["--improve", "nowhere"], 2, "nowhere"),
    ],
)
def test_mistakes_are_named(
    robot: Path,
    tmp_path: Path,
    words: list[str],
    code: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert plan(robot, tmp_path / "plan.csv", "-n", "3", *words) == code
    assert said in capsys.readouterr().err
    assert not (tmp_path / "plan.csv").exists()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.yaml", "avoid:\n  - {l_kne: [0, 1]}\n", "l_knee"),
        ("a.yaml", "avoid:\n  - {l_knee: [1, 0]}\n", "lower before upper"),
        ("a.yaml", "avoid: 3\n", "must be a list"),
        ("a.csv", "pose,x\n1,2\n", "q.<joint>"),
        ("a.csv", "pose,q.l_kne\n1,2\n", "l_knee"),
    ],
)
def test_files_to_avoid_that_mean_nothing_are_refused(
    robot: Path,
    tmp_path: Path,
    name: str,
    content: str,
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / name).write_text(content)
    assert plan(robot, tmp_path / "plan.csv", "--avoid", str(tmp_path / name)) == 2
    assert said in capsys.readouterr().err


def test_ranges_of_a_file_are_kept_out_of(robot: Path, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("avoid:\n  - {waist_pitch: [0.1, 9]}\n")
    path = tmp_path / "plan.csv"
    avoid = ["--avoid", str(tmp_path / "a.yaml")]
    assert plan(robot, path, "-n", "4", "--support", "left", *avoid) == 0
    names = load_robot(robot).tree.joint_names
    q = np.array([p.q for p in read_plan(path, names)])
    assert q[:, names.index("waist_pitch")].max() < 0.1
