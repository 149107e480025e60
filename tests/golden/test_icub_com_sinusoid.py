# SPDX-License-Identifier: Apache-2.0
"""iCub sways on both feet, only whose vertical force is known: what that says, and no more."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from comcal.cli.main import main
from comcal.measure.poses_csv import read_poses
from comcal.measure.session import open_session
from comcal.measure.table import PoseTable
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Tree

HERE = Path(__file__).parent / "icub_com_sinusoid"
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """The folder with map, robot and log, and the session made of them."""

    folder: Path
    session: Path
    robot: Robot
    table: PoseTable


@pytest.fixture(scope="module")
def case(shared_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Case:
    data = shared_dir / "data" / "icub_com_sinusoid"
    if not data.is_dir():
        pytest.skip(f"no log in {data}")
    folder = tmp_path_factory.mktemp("sinusoid")
    for source in (HERE, data):
        for name in ("robot.yaml", "map.yaml", "model.urdf", "com-sinusoid.csv"):
            if (source / name).is_file():
                shutil.copyfile(source / name, folder / name)
    session = folder / "session"
    typed = ["import", str(folder / "com-sinusoid.csv"), "--map", str(folder / "map.yaml")]
    assert main([*typed, "-s", str(session), "--quasi-static", "--from", "9.2"]) == 0
    opened = open_session(session)
    robot = load_robot(opened.robot_yaml)
    return Case(folder, session, robot, read_poses(opened.poses_csv, robot, opened.tares()))


def lateral(tree: Tree, q: Array, left: Array, right: Array) -> tuple[Array, Array, Array]:
    """Return CoM and load split along the line from right to left sole, and the soles' distance."""
    at = place_links(tree, q)
    p_left, p_right = (at.p[:, tree.link_index[name]] for name in ("l_sole", "r_sole"))
    apart = np.linalg.norm(p_left - p_right, axis=1)
    com = np.einsum("k,nki->ni", tree.masses, at.coms) / tree.total_mass
    y = np.einsum("ni,ni->n", com - 0.5 * (p_left + p_right), p_left - p_right) / apart
    return y, 0.5 * apart * (left - right) / (left + right), apart


def test_figures_of_those_who_looked_at_the_log_before(case: Case) -> None:
    """334.9 +- 1.1 N against 324.5 N; 53 mm, slope 0.62, 3.3 mm rms; 3.7 mm between the feet."""
    log = np.genfromtxt(case.folder / "com-sinusoid.csv", delimiter=",", names=True)
    names = case.robot.tree.joint_names
    zero = np.zeros(log.size)
    q = np.column_stack(
        [log[f"q_{n}"] if f"q_{n}" in (log.dtype.names or ()) else zero for n in names]
    )
    total = log["lf_fz_N"] + log["rf_fz_N"]
    assert total.mean() == pytest.approx(334.9, abs=0.1)
    assert total.std() == pytest.approx(1.1, abs=0.05)
    assert case.robot.tree.total_mass * 9.81 == pytest.approx(324.5, abs=0.05)

    com, split, apart = lateral(case.robot.tree, q, log["lf_fz_N"], log["rf_fz_N"])
    line = np.polyfit(com, split, 1)
    assert 1e3 * np.ptp(com) == pytest.approx(53.0, abs=1.0)
    assert line[0] == pytest.approx(0.62, abs=0.02)
    assert 1e3 * np.std(split - np.polyval(line, com)) < 3.5
    assert 1e3 * np.ptp(apart) == pytest.approx(3.7, abs=0.3)


def test_bursts_of_samples_are_refused(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    typed = [
        "import",
        str(case.folder / "com-sinusoid.csv"),
        "--map",
        str(case.folder / "map.yaml"),
    ]
    whole = case.folder / "whole"
    assert main([*typed, "-s", str(whole), "--quasi-static"]) == 3
    assert "not sampled regularly" in capsys.readouterr().err
    assert not whole.exists()


def test_windows_hold_the_sway(case: Case) -> None:
    left, right = (case.table.wrench[f"{side}_plate"][:, 2] for side in ("left", "right"))
    com, split, _ = lateral(case.robot.tree, case.table.q, left, right)
    assert len(case.table) >= 12
    assert 1e3 * np.ptp(com) > 45.0
    assert np.polyfit(com, split, 1)[0] == pytest.approx(0.62, abs=0.05)


def test_excess_of_weight_is_found_and_not_called_a_mass(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["solve", str(case.session)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "common to the sensors that carry the robot, would weigh the same" in out

    result = json.loads((case.session / "results" / "latest" / "result.json").read_text("utf-8"))
    mass = result["mass"]
    assert mass["value"] - mass["urdf"] == pytest.approx(1.06, abs=0.15)
    assert 0.2 < mass["sigma"] < 0.4
    assert mass["value"] - mass["urdf"] > 3.0 * mass["sigma"]


def test_com_is_not_claimed_better_than_the_soles_are_wide(case: Case) -> None:
    """Where on a sole the force acts is assumed: 16 mm sideways, 35 mm forwards, in all windows."""
    result = json.loads((case.session / "results" / "latest" / "result.json").read_text("utf-8"))
    for pose in result["coefficients"]:
        assert pose["sigma"]["alpha"] > 0.03
        assert pose["sigma"]["gamma"] > 0.015
    assert not any(any(link["identifiable"]) for link in result["links"])
