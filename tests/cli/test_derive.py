# SPDX-License-Identifier: Apache-2.0
"""``comcal derive``: what it prints, writes, refuses, and that it agrees with ``comcal solve``."""

from __future__ import annotations

import json
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.robot.description import load_robot
from comcal.robot.kinematics import place_links
from comcal.statics.stance import in_stance
from comcal_sims.robots import biped14, table1

PAPER = """\
format: comcal-configurations/1
configurations:
  a: [0, 0]
  b: [theta_b, theta_b]
  c: [0, 30 deg]
"""
SPATIAL = """\
format: comcal-configurations/1
configurations:
  home: [0, 0, 0]
  roll: [30 deg, 0, 0]
  pitch: [0, theta_hip, 0]
  bent: [0, theta_hip, 45 deg]
"""
ENGINES = [
    "builtin",
    pytest.param(
        "pybullet",
        marks=[
            pytest.mark.engine,
            pytest.mark.skipif(not find_spec("pybullet"), reason="no pybullet here"),
        ],
    ),
]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return table1.generate(tmp_path_factory.mktemp("robot"), r_b=0.01, r_c=-0.02)


@pytest.fixture
def paper(tmp_path: Path) -> Path:
    path = tmp_path / "paper.yaml"
    path.write_text(PAPER)
    return path


@pytest.fixture(scope="module")
def spatial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A robot whose hip joints turn about three axes, and shapes of that hip."""
    folder = tmp_path_factory.mktemp("spatial")
    shapes = folder / "shapes.yaml"
    shapes.write_text(SPATIAL)
    return biped14.generate(folder / "robot"), shapes


def function_of(text: str, name: str):
    namespace: dict = {}
    exec(compile(text, "generated", "exec"), namespace)
    return namespace[name]


@pytest.mark.parametrize("what", ["link-com", "total-com", "coefficients", "sigma"])
@pytest.mark.parametrize("language", ["text", "python", "c", "latex"])
def test_everything_is_derived_in_every_language(
    what: str, language: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["derive", "--dof", "2", "--what", what, "--format", language]) == 0
    out = capsys.readouterr().out
    begins = {"python": '"""', "c": "/*\n", "latex": r"\documentclass"}
    assert out.startswith(begins.get(language, ""))
    assert len(out.splitlines()) > 20


def test_configurations_of_a_file_are_solved(
    paper: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["derive", "--dof", "2", "--configurations", str(paper), "--format", "python"]
    assert main(command) == 0
    link_coms = function_of(capsys.readouterr().out, "link_coms")
    w, m, L, U, theta_b = np.array([0.2 + 0.01j, 0.3 - 0.02j]), np.array([2, 3]), 0.4, 0.05, 0.7
    phi = np.array([[0, 0], [theta_b, theta_b], [0, np.pi / 6]])
    e = np.exp(1j * phi)
    com = (m[0] * (U + w[0] * e[:, 0]) + m[1] * (U + L * e[:, 0] + w[1] * e[:, 1])) / 5.0
    r, along, det, x, z = link_coms(com.imag, com.real, theta_b, m, [L], 0, 0, 0, U)
    assert along + 1j * r == pytest.approx(w, abs=1e-12)
    assert det == pytest.approx(2 * np.sin(np.pi / 12))
    assert [*x, *z] == pytest.approx([0, 0], abs=1e-12)


def test_a_robot_brings_its_own_numbers(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["derive", "--robot", str(robot), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [q["name"] for q in found["inputs"]] == ["X", "Z", "theta"]
    assert [q["name"] for q in found["outputs"]] == ["r", "l", "determinant"]
    assert found["format"] == "comcal-derivation/1"


def test_a_spatial_robot_is_told_what_statics_cannot_see(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = biped14.generate(tmp_path / "robot")
    ends = ["--base", "l_thigh", "--tip", "pelvis"]
    assert main(["derive", "--robot", str(path), *ends]) == 0
    out = capsys.readouterr().out
    assert "7 combinations of 9 first moments" in out
    assert "2 directions change no total CoM in any pose" in out


@pytest.mark.parametrize("language", ["text", "python", "c", "latex"])
@pytest.mark.parametrize(
    ("configurations", "what"),
    [
        *product(["one-joint", "free", "file"], ["link-com", "sigma"]),
        ("one-joint", "rows"),
    ],
)
def test_a_spatial_robot_is_solved_in_every_language(
    configurations: str,
    language: str,
    what: str,
    spatial: tuple[Path, ...],
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, shapes = spatial
    chosen = str(shapes) if configurations == "file" else configurations
    command = ["derive", "--robot", str(path), "--base", "pelvis", "--tip", "l_shin"]
    command += ["--configurations", chosen, "--what", what, "--format", language]
    assert main(command) == 0
    assert len(capsys.readouterr().out.splitlines()) > 30


def test_a_spatial_robot_gives_its_own_first_moments(
    spatial: tuple[Path, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """The true CoM of four shapes in, the CoMs of thigh and shank across the pitch axis out."""
    path, shapes = spatial
    command = ["derive", "--robot", str(path), "--base", "pelvis", "--tip", "l_shin"]
    command += ["--configurations", str(shapes), "--format", "python"]
    assert main(command) == 0
    first_moments = function_of(capsys.readouterr().out, "first_moments")
    robot = load_robot(path)
    roll, hip, knee = (
        robot.tree.joint_names.index(f"l_{joint}") for joint in ("hip_roll", "hip_pitch", "knee")
    )
    q = np.zeros((4, len(robot.tree.joint_names)))
    q[1, roll], q[2:, hip], q[3, knee] = np.pi / 6, 0.4, np.pi / 4
    at = place_links(robot.tree, q)
    at = in_stance(*at.link("pelvis"), at)
    _, c, misfit, _ = first_moments(com=at.total_com(), theta_hip=0.4)
    index = robot.tree.link_index
    leg = robot.tree.descendants[index["l_shin"]] * robot.tree.masses
    shank = leg @ at.coms[0] / leg.sum() - at.p[0, index["l_shin"]]
    thigh = at.coms[0, index["l_thigh"]] - at.p[0, index["l_thigh"]]
    assert c[-4:] == pytest.approx([thigh[2], thigh[0], shank[2], shank[0]], abs=1e-12)
    assert misfit == pytest.approx(0, abs=1e-12)


def test_a_long_spatial_chain_is_for_one_joint_at_a_time(
    spatial: tuple[Path, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = spatial
    assert main(["derive", "--robot", str(path), "--format", "python"]) == 0
    assert "def first_moments(com, q):" in capsys.readouterr().out
    assert main(["derive", "--robot", str(path), "--configurations", "free"]) == 2
    error = capsys.readouterr().err
    assert "5 joints" in error
    assert "one-joint" in error


@pytest.mark.parametrize("engine", ENGINES)
def test_generated_code_fed_with_a_session_agrees_with_solve(
    engine: str, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "session"
    record = ["record", str(robot), "-s", str(session), "--source", engine, "--seed", "7"]
    assert main(record) == 0
    capsys.readouterr()
    assert main(["derive", "--session", str(session), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["difference"] < 1e-9
    assert len(found["configurations"]) == len(found["segments"]) == 2
    # The CoMs are noisy ones of this very robot, not zeros that agree with zeros.
    assert found["generated"]["l"][0] == pytest.approx(0.2, abs=0.05)
    assert found["generated"]["r"] != pytest.approx([0, 0], abs=1e-4)


def test_a_file_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "made.py"
    command = ["derive", "--dof", "1", "--format", "python", "-o", str(path)]
    assert main(command) == 0
    before = path.read_text()
    assert "def link_coms(" in before
    assert main(command) == 2
    assert "not overwritten" in capsys.readouterr().err
    assert path.read_text() == before
    assert main([*command[:-1], str(tmp_path / "no folder" / "made.py")]) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "give --dof N or --robot"),
        (["--dof", "2", "--robot", "r.yaml"], "give one of"),
        (["--dof", "2", "--tip", "waist"], "--base and --tip"),
        (["--dof", "0"], "limit 1 to 200"),
        (["--dof", "13", "--configurations", "free"], "one-joint"),
        (["--dof", "2", "--configurations", "nothing.yaml"], "no such file"),
        (["--robot", "nothing.yaml"], "no such file"),
        (["--dof", "2", "--what", "rows"], "for the chain of a robot"),
    ],
)
def test_what_cannot_be_derived_is_refused(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["derive", *options]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("comcal-configurations/1", "comcal-robot/1", "paper.yaml:1"),
        ("format:", "extra: 1\nformat:", "extra"),
        ("[0, 30 deg]", "[0, 30 deg, 0]", "paper.yaml:5: configuration 'c' needs one angle"),
        ("[0, 30 deg]", "30 deg", "no list"),
        ("30 deg", "30 grad", "'30 grad' is not an angle"),
        ("30 deg", "m_b", "does not look like an angle"),
        ("30 deg", "__import__('os')", "is not an angle"),
        ("  c:", "  c-1:", "cannot name a configuration"),
    ],
)
def test_a_wrong_file_is_answered_with_its_line(
    old: str, new: str, words: str, paper: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in PAPER
    paper.write_text(PAPER.replace(old, new))
    assert main(["derive", "--dof", "2", "--configurations", str(paper)]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("what", ["link-com", "sigma"])
def test_one_shape_is_exit_code_3(
    what: str, paper: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paper.write_text(PAPER.replace("[0, 30 deg]", "[theta_c, theta_c]"))
    assert main(["derive", "--dof", "2", "--configurations", str(paper), "--what", what]) == 3
    assert "one shape" in capsys.readouterr().err


@pytest.mark.parametrize(("equation", "code"), [("35", 0), ("36", 5), ("42", 5)])
def test_the_paper_s_equations_are_checked_by_one_command(
    equation: str, code: int, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = root / "tests" / "golden" / "muscolo_equations" / f"equation_{equation}.yaml"
    assert main(["derive", "--check", str(path)]) == code
    assert capsys.readouterr().out.strip()
    assert main(["derive", "--check", str(path), "--json"]) == code
    assert json.loads(capsys.readouterr().out)["agrees"] is (code == 0)
