# SPDX-License-Identifier: Apache-2.0
"""``comcal generate``: parameters reach the URDF, mistakes are named, files are kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from comcal.cli.main import main
from comcal.robot.description import load_robot


def test_parameters_reach_the_robot(tmp_path: Path) -> None:
    assert main(["generate", "table1", "-o", str(tmp_path / "r"), "--set", "r_b=0.01"]) == 0
    tree = load_robot(tmp_path / "r" / "robot.yaml").tree
    assert tree.coms[tree.link_index["l_shin"]].tolist() == pytest.approx([0.01, 0.0, -0.2])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["table2"], "table1"),
        (["table1", "--set", "r_x=1"], "did you mean"),
        (["table1", "--set", "r_b=ten"], "KEY=NUMBER"),
        (["table1", "--set", "r_b"], "KEY=NUMBER"),
        (["table1", "--set", "r_b=nan"], "KEY=NUMBER"),
    ],
)
def test_mistakes_are_exit_2_and_name_what_would_work(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", *arguments, "-o", str(tmp_path / "r")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "r" / "robot.yaml").exists()


def test_existing_files_are_never_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", "biped14", "-o", str(tmp_path)]) == 0
    before = (tmp_path / "robot.yaml").read_bytes()
    assert main(["generate", "table1", "-o", str(tmp_path)]) == 2
    assert (tmp_path / "robot.yaml").read_bytes() == before
    assert not (tmp_path / "table1.urdf").exists()
