# SPDX-License-Identifier: Apache-2.0
"""``comcal derive``: what it prints, writes, refuses, and that it agrees with ``comcal solve``."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal_sims.robots import biped14, table1

PAPER = """\
format: comcal-configurations/1
configurations:
  a: [0, 0]
  b: [theta_b, theta_b]
  c: [0, 30 deg]
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
    assert main(["derive", "--robot", str(path)]) == 2
    assert "5 joints" in capsys.readouterr().err


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
