# SPDX-License-Identifier: Apache-2.0
"""``comcal tare`` as typed, with the built-in world: hidden offsets come back."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from comcal.measure.session import open_session
from comcal.measure.source import SourceRequest
from comcal.robot.description import load_robot
from comcal_sims.robots.biped14 import generate
from comcal_sims.sources import SampledWorld, open_builtin

Run = Callable[..., tuple[int, str, str]]
SEED = 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A biped whose force sensors have offsets of many newtons."""
    folder = tmp_path_factory.mktemp("biped14")
    yaml = generate(folder)
    offsets = "sources: {builtin: {ft_force_bias: 15.0, ft_moment_bias: 1.0}}\n"
    yaml.write_text(yaml.read_text() + offsets)
    return folder


@pytest.fixture(scope="module")
def offsets(folder: Path) -> dict[str, np.ndarray]:
    """What is hidden under this seed."""
    robot = load_robot(folder / "robot.yaml")
    world = open_builtin(SourceRequest(robot, SEED, options=robot.sources["builtin"]))
    assert isinstance(world, SampledWorld)
    return world._adapter._bias


def arguments(command: str, folder: Path, session: Path, *more: str) -> list[str]:
    yaml = str(folder / "robot.yaml")
    return [command, yaml, "-s", str(session), "--source", "builtin", "--seed", str(SEED), *more]


def test_the_tare_is_the_hidden_offset_and_a_calibration_is_right_with_it(
    folder: Path, tmp_path: Path, run: Run, offsets: dict[str, np.ndarray]
) -> None:
    code, out, err = run(*arguments("tare", folder, tmp_path / "s"))
    assert (code, err) == (0, "")
    assert "N hung below the cut; up is by the IMU on pelvis" in out
    tares = open_session(tmp_path / "s").tares()
    for sensor, (value, sigma) in tares.items():
        assert np.abs((value - offsets[sensor]) / sigma).max() < 4.0
    assert run(*arguments("record", folder, tmp_path / "s"))[0] == 0
    assert run(*arguments("record", folder, tmp_path / "untared"))[0] == 0
    assert open_session(tmp_path / "s").tares().keys() == offsets.keys()
    mass = {}
    for name in ("s", "untared"):
        code, out, err = run("solve", tmp_path / name, "--json", "--method", "lstsq")
        assert code in (0, 5), err
        mass[name] = json.loads(out)["mass"]
    true = load_robot(folder / "robot.yaml").tree.total_mass
    assert abs(mass["s"]["value"] - true) < 4.0 * mass["s"]["sigma"]
    assert abs(mass["untared"]["value"] - true) > 10.0 * mass["s"]["sigma"]


def test_a_lifted_foot_is_tared_while_the_other_stands(
    folder: Path, tmp_path: Path, run: Run, offsets: dict[str, np.ndarray]
) -> None:
    code, _, err = run(*arguments("tare", folder, tmp_path / "s", "--standing", "left"))
    assert (code, err) == (0, "")
    value, sigma = open_session(tmp_path / "s").tares()["r_foot"]
    assert np.abs((value - offsets["r_foot"]) / sigma).max() < 4.0
    assert list(open_session(tmp_path / "s").tares()) == ["r_foot"]


def test_an_older_tare_stays_unless_told_otherwise(folder: Path, tmp_path: Path, run: Run) -> None:
    assert run(*arguments("tare", folder, tmp_path / "s"))[0] == 0
    before = (tmp_path / "s" / "session.yaml").read_bytes()
    code, _, err = run(*arguments("tare", folder, tmp_path / "s"))
    assert code == 2
    assert "--again" in err
    assert (tmp_path / "s" / "session.yaml").read_bytes() == before
    code, out, _ = run(*arguments("tare", folder, tmp_path / "s", "--again", "--seconds", "2"))
    assert code == 0
    assert "since the tare before" in out
    history = open_session(tmp_path / "s").metadata["tare_history"]
    assert [entry["sensor"] for entry in history] == ["l_foot", "r_foot"]


def test_json_is_alone_on_standard_output(
    folder: Path, tmp_path: Path, run: Run, offsets: dict[str, np.ndarray]
) -> None:
    code, out, _ = run(*arguments("tare", folder, tmp_path / "s", "--json"))
    assert code == 0
    found = json.loads(out)
    assert found["format"] == "comcal-tare/1"
    np.testing.assert_allclose(found["tares"]["l_foot"]["value"], offsets["l_foot"], atol=0.2)
    assert found["tares"]["l_foot"]["before"] is None


def test_an_offset_hidden_as_an_effect_is_tared_too(
    folder: Path, tmp_path: Path, run: Run, offsets: dict[str, np.ndarray]
) -> None:
    hidden = ("--effect", "ft_bias@l_foot:fz=9.0")
    assert run(*arguments("tare", folder, tmp_path / "s", *hidden))[0] == 0
    value, _ = open_session(tmp_path / "s").tares()["l_foot"]
    assert value[2] == pytest.approx(offsets["l_foot"][2] + 9.0, abs=0.2)
    assert "seed" not in open_session(tmp_path / "s").metadata  # sealed, as by comcal record
    assert run(*arguments("record", folder, tmp_path / "s"))[0] == 2
    assert run(*arguments("record", folder, tmp_path / "s", *hidden))[0] == 0


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        (["--sensor", "l_fot"], 2, "did you mean l_foot"),
        (["--standing", "middle"], 2, "there are: left, right"),
        (["--standing", "left", "--sensor", "l_foot"], 2, "foot left stands"),
        (["--limit", "3"], 3, "is loaded"),
        (["--seconds", "30", "--timeout", "5"], 3, "not still for 30 s"),
        (["--source", "nothing"], 2, "there is no source"),
    ],
)
def test_what_cannot_be_tared_says_why(
    folder: Path, tmp_path: Path, run: Run, more: list[str], code: int, words: str
) -> None:
    found, out, err = run(*arguments("tare", folder, tmp_path / "s", *more))
    assert (found, out) == (code, "")
    assert words in err
    session = tmp_path / "s" / "session.yaml"
    assert not session.exists() or "tare" not in session.read_text()
