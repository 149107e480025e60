# SPDX-License-Identifier: Apache-2.0
"""``comcal record --effect``: hidden in the data, and nowhere else in the session folder."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.plan_csv import read_plan, write_plan
from comcal.measure.session import open_session
from comcal.robot.changes_text import parse_change
from comcal.robot.changes_yaml import KnownChange, extension_text
from comcal.robot.description import load_robot
from comcal.workflow.sealed import read_truth, truth_path
from comcal_sims.robots.table1 import generate

Run = Callable[..., tuple[int, str, str]]
PAYLOAD = "payload@waist:mass=1.23456789,com_x=0.0678912345"
SEED = "271828182"


@pytest.fixture(scope="module")
def robot_yaml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Table 1 robot with the first three poses of its plan."""
    folder = tmp_path_factory.mktemp("table1")
    path = generate(folder)
    joints = load_robot(path).tree.joint_names
    poses = read_plan(folder / "plan.csv", joints)[:3]
    (folder / "plan.csv").unlink()
    write_plan(folder / "plan.csv", poses, joints)
    return path


def arguments(robot_yaml: Path, session: Path, *more: str) -> list[str]:
    return ["record", str(robot_yaml), "-s", str(session), "--source", "builtin", *more]


def test_nothing_in_the_session_folder_betrays_what_is_hidden(
    robot_yaml: Path, tmp_path: Path, run: Run
) -> None:
    session = tmp_path / "s"
    effects = ("--effect", PAYLOAD, "--effect", "ft_drift@l_foot:fz=0.0091234567")
    assert run(*arguments(robot_yaml, session, "--seed", SEED, *effects))[0] == 0
    secrets = ["payload", "ft_drift", "1.23456789", "0.0678912345", "0.0091234567", SEED]
    # in binary as well: raw samples are in the folder too
    words = [word.encode() for word in secrets] + [np.float64(1.23456789).tobytes()]
    for file in (f for f in session.rglob("*") if f.is_file()):
        content = file.read_bytes()
        assert not [word for word in words if word in content], file
    metadata = open_session(session).metadata
    assert "seed" not in metadata
    assert re.fullmatch(r"[0-9a-f]{64}", str(metadata["sealed"]))
    truth = read_truth(session)
    assert truth_path(session) == tmp_path / "s.truth.yaml"
    assert truth.seed == int(SEED)
    assert truth.changes[0] == parse_change(PAYLOAD)
    assert truth.seal() == metadata["sealed"]
    assert load_robot(session / "robot.yaml").tree.total_mass == pytest.approx(
        load_robot(robot_yaml).tree.total_mass
    )


def test_columns_are_the_same_whatever_is_hidden(
    robot_yaml: Path, tmp_path: Path, run: Run
) -> None:
    headers = set()
    for i, effect in enumerate((PAYLOAD, "ft_temperature@l_foot:fz=0.1", "ground_tilt:roll=0.01")):
        session = tmp_path / f"s{i}"
        assert run(*arguments(robot_yaml, session, "--effect", effect))[0] == 0
        headers.add((session / "poses.csv").read_text().splitlines()[0])
    assert len(headers) == 1


def test_the_same_command_goes_on_and_another_one_does_not(
    robot_yaml: Path, tmp_path: Path, run: Run
) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    effects = ("--effect", PAYLOAD, "--effect", "joint_friction@all:coulomb=1")
    assert run(*arguments(robot_yaml, whole, "--seed", SEED, *effects))[0] == 0
    plan = robot_yaml.with_name("plan.csv").read_text().splitlines(keepends=True)
    short = tmp_path / "plan.csv"
    short.write_text("".join(plan[:3]))
    first = arguments(robot_yaml, parts, "--poses", str(short), "--seed", SEED, *effects)
    assert run(*first)[0] == 0
    short.write_text("".join(plan))
    again = arguments(robot_yaml, parts, "--poses", str(short))
    assert run(*again, *effects)[0] == 0  # the seed is known
    assert (whole / "poses.csv").read_bytes() == (parts / "poses.csv").read_bytes()
    for more in ((), ("--effect", PAYLOAD), (*effects, "--seed", "1")):
        code, _, err = run(*again, *more)
        assert code == 2
        assert "begun with other effects or another seed" in err


def test_a_session_without_effects_does_not_go_on_with_some(
    robot_yaml: Path, tmp_path: Path, run: Run
) -> None:
    assert run(*arguments(robot_yaml, tmp_path / "s"))[0] == 0
    code, _, err = run(*arguments(robot_yaml, tmp_path / "s", "--effect", PAYLOAD))
    assert code == 2
    assert "begun without hidden effects" in err
    assert not truth_path(tmp_path / "s").exists()


def test_a_refused_folder_gets_no_truth_and_an_old_truth_is_kept(
    robot_yaml: Path, tmp_path: Path, run: Run
) -> None:
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "diary.txt").write_text("not a session")
    assert run(*arguments(robot_yaml, tmp_path / "s", "--effect", PAYLOAD))[0] == 2
    assert not truth_path(tmp_path / "s").exists()
    truth_path(tmp_path / "t").write_text("of a session that was deleted")
    code, _, err = run(*arguments(robot_yaml, tmp_path / "t", "--effect", PAYLOAD))
    assert code == 2
    assert "truth already" in err
    assert not (tmp_path / "t").exists()
    assert truth_path(tmp_path / "t").read_text() == "of a session that was deleted"


def test_an_extended_model_is_simulated(robot_yaml: Path, tmp_path: Path, run: Run) -> None:
    extended = tmp_path / "extended.yaml"
    known = [KnownChange(parse_change(PAYLOAD), {"mass": 0.1})]
    extended.write_text(extension_text(known), "utf-8")
    by_model = arguments(robot_yaml, tmp_path / "a", "--seed", "1", "--model", str(extended))
    by_effect = arguments(robot_yaml, tmp_path / "b", "--seed", "1", "--effect", PAYLOAD)
    assert run(*by_model)[0] == run(*by_effect)[0] == 0
    rows = [(tmp_path / x / "poses.csv").read_bytes() for x in "ab"]
    assert rows[0] == rows[1]


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("paylod@waist:mass=1", "did you mean 'payload'"),
        ("payload@wast:mass=1", "did you mean 'waist'"),
        ("not_settled:time=1", "use --source pybullet or mujoco"),
    ],
)
def test_mistyped_effects_leave_nothing_behind(
    robot_yaml: Path, tmp_path: Path, run: Run, effect: str, words: str
) -> None:
    code, _, err = run(*arguments(robot_yaml, tmp_path / "s", "--effect", effect))
    assert code == 2
    assert words in err
    assert not list(tmp_path.iterdir())
