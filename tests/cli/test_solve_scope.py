# SPDX-License-Identifier: Apache-2.0
"""``comcal solve`` with and without currents, with free masses, with unknown tares."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

SCHEMA = json.loads(files("comcal.report").joinpath("result.schema.json").read_text("utf-8"))

TRUSTED = "tolerances: {joint_friction: 0.0, torque_constant: 0.01}"
"""What lets currents count."""

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def session(misbuilt, tmp_path: Path) -> Path:
    """A recording with feet, motors and an IMU, some of its poses hanging."""
    copy = tmp_path / "session"
    copy.mkdir()
    shutil.copy(misbuilt.fresh / "biped14.urdf", copy)
    described = (misbuilt.fresh / "robot.yaml").read_text("utf-8")
    (copy / "robot.yaml").write_text(f"{described}\n{TRUSTED}\n", "utf-8")
    header, *rows = (misbuilt.fresh / "poses.csv").read_text("utf-8").splitlines()
    hung = [row for row in rows if ",none," in row][:2]
    standing = [row for row in rows if ",none," not in row][::2]
    (copy / "poses.csv").write_text("\n".join([header, *standing, *hung]) + "\n", "utf-8")
    return copy


def solved(run: Run, session: Path, *options: str) -> dict:
    code, out, _ = run("solve", session, "--method", "lstsq", "--json", *options)
    assert code in (0, 5)
    result = json.loads(out)
    jsonschema.validate(result, SCHEMA)
    return result


def test_currents_are_used_and_the_same_without_them_stands_beside(run: Run, session: Path):
    result = solved(run, session)
    alone = solved(run, session, "--no-currents")
    assert result["scope"]["torques"]
    assert not alone["scope"]["torques"]
    assert alone["without_torques"] is None
    assert result["without_torques"]["rank"] == alone["rank"] == result["rank"]
    assert result["without_torques"]["chi2"] == pytest.approx(alone["chi2"])
    assert result["condition"] < alone["condition"]
    assert result["held_out"]["torque_rms"] > 0
    assert alone["held_out"]["torque_rms"] is None

    _, text, _ = run("solve", session, "--method", "lstsq")
    assert "What joint torques add to the foot wrenches" in text
    assert "joint torque" in text


def test_currents_whose_friction_nobody_states_are_not_used(run: Run, session: Path):
    described = session / "robot.yaml"
    described.write_text(described.read_text("utf-8").replace(TRUSTED, ""), "utf-8")
    result = solved(run, session)
    assert result["without_torques"] is None
    assert any("currents are not used" in note for note in result["notes"])


def test_free_masses_name_the_sums_that_are_determined(run: Run, session: Path):
    result = solved(run, session, "--free-masses", "--no-currents")
    known = solved(run, session, "--no-currents")
    assert result["rank"] == known["rank"]
    assert result["unknowns"] > known["unknowns"]
    assert {link["mass_source"] for link in result["links"]} <= {"prior", "combination", "measured"}
    sums = [c for c in result["combinations"] if any("mass" in n for n in c["coefficients"])]
    assert sums
    assert result["mass"]["value"] == pytest.approx(known["mass"]["value"], abs=1e-6)
    assert any("as a mass on the axis of l_knee" in u["remedy"] for u in result["unseen"])


def test_unknown_tares_are_found_in_the_session(run: Run, session: Path):
    """An offset added to a column of poses.csv comes back, and the CoMs stay where they were."""
    before = solved(run, session, "--unknown-tares", "--no-currents")
    poses = session / "poses.csv"
    header, *rows = [line.split(",") for line in poses.read_text("utf-8").splitlines()]
    column = header.index("ft.l_foot.fx")
    for row in rows:
        row[column] = repr(float(row[column]) + 7.0)
    poses.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n", "utf-8")
    after = solved(run, session, "--unknown-tares", "--no-currents")

    def offset(result: dict) -> float:
        return next(c["value"] for c in result["combinations"] if c["words"] == "l_foot offset fx")

    assert offset(after) - offset(before) == pytest.approx(7.0, abs=1e-3)
    assert after["chi2"] == pytest.approx(before["chi2"], rel=1e-3)
