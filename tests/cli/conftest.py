# SPDX-License-Identifier: Apache-2.0
"""A biped that is not built as its URDF says, measured twice."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from comcal.cli.main import main
from comcal.robot.urdf import read_urdf
from comcal.robot.urdf_write import InertialEdit, write_inertials
from comcal_sims.robots import biped14


@dataclass(frozen=True)
class Misbuilt:
    """A robot with wrong CoMs and masses in its URDF.

    ``solved`` and ``fresh`` are two recordings of it (seeds 1, 2), both solved, whose frozen model
    is ``nominal``, the URDF before anything was measured; ``true`` is the robot as it is built.
    """

    solved: Path
    fresh: Path
    nominal: Path
    true: Path


def session_of(folder: Path, robot_yaml: Path, seed: int, nominal: Path) -> Path:
    """Record the robot of *robot_yaml*; the session believes it to be *nominal*."""
    recording = folder / f"recording{seed}"
    arguments = ["record", str(robot_yaml), "-s", str(recording), "--source", "builtin"]
    assert main([*arguments, "--seed", str(seed)]) == 0
    session = folder / f"session{seed}"
    session.mkdir()
    for file in (robot_yaml, nominal, recording / "poses.csv"):
        shutil.copy(file, session)
    # Half of them without currents, which is faster: both kinds of result have to do.
    options = ["--no-currents", "--method", "lstsq"] if seed > 1 else []
    assert main(["solve", str(session), *options]) in (0, 5)
    return session


@pytest.fixture(scope="session")
def misbuilt(tmp_path_factory: pytest.TempPathFactory) -> Misbuilt:
    folder = tmp_path_factory.mktemp("misbuilt")
    nominal = biped14.generate(folder / "nominal").with_name("biped14.urdf")
    built = shutil.copytree(nominal.parent, folder / "built")
    rng = np.random.default_rng(3)
    edits = []
    for link in read_urdf(nominal).links:
        if link.mass > 0.5:  # neither yokes nor soles
            x, y, z = link.com + 0.012 * rng.standard_normal(3)
            edits.append(
                InertialEdit(
                    link.name,
                    (float(x), float(y), float(z)),
                    1.0 + 0.05 * float(rng.standard_normal()),
                )
            )
    true = built / nominal.name
    true.write_bytes(write_inertials(nominal.read_bytes(), nominal.name, edits))
    first, second = (session_of(folder, built / "robot.yaml", seed, nominal) for seed in (1, 2))
    return Misbuilt(first, second, nominal, true)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command; return its exit code, standard output and standard error."""

    def call(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return call
