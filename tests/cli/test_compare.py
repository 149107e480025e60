# SPDX-License-Identifier: Apache-2.0
"""``comcal compare``: noise is no change, a moved mass is one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from comcal.identify.differences import limit_for
from comcal.robot.urdf import read_urdf
from comcal.robot.urdf_write import InertialEdit, write_inertials


def test_two_recordings_of_one_robot_show_no_change(misbuilt, run) -> None:
    code, out, _ = run("compare", misbuilt.solved, misbuilt.fresh)
    assert code == 0
    assert "Verdict: NO CHANGE" in out


def test_results_alone_can_be_compared(misbuilt, run) -> None:
    results = [s / "results/latest/result.json" for s in (misbuilt.solved, misbuilt.fresh)]
    code, out, _ = run("compare", *results, "--json")
    assert code == 0
    content = json.loads(out)
    assert content["verdict"] == "no_change"
    assert {c["kind"] for c in content["changes"]} == {"mass", "link"}


def test_a_payload_is_found_where_it_is(misbuilt, tmp_path, run) -> None:
    from comcal.cli.main import main

    loaded = Path(shutil.copytree(misbuilt.true.parent, tmp_path / "loaded"))
    urdf = loaded / misbuilt.true.name
    torso = next(link for link in read_urdf(urdf).links if link.name == "torso")
    com = (float(torso.com[0] + 0.01), None, float(torso.com[2] + 0.01))
    edit = InertialEdit("torso", com, 1.02)
    urdf.write_bytes(write_inertials(misbuilt.true.read_bytes(), urdf.name, [edit]))
    recording, session = tmp_path / "recording", tmp_path / "session"
    robot = str(loaded / "robot.yaml")
    assert main(["record", robot, "-s", str(recording), "--source", "builtin", "--seed", "5"]) == 0
    session.mkdir()
    for file in (loaded / "robot.yaml", misbuilt.nominal, recording / "poses.csv"):
        shutil.copy(file, session)
    assert main(["solve", str(session), "--no-currents", "--method", "lstsq"]) in (0, 5)
    code, out, _ = run("compare", misbuilt.solved, session, "--json")
    assert code == 5
    changed = {c["name"]: c for c in json.loads(out)["changes"] if c["changed"]}
    assert {"mass", "torso x", "total CoM x"} <= set(changed)
    assert changed["mass"]["change"] == pytest.approx(0.02 * torso.mass, abs=0.02)
    assert not {name for name in changed if "shin" in name or "foot" in name}


def test_robots_with_other_links_are_refused(misbuilt, tmp_path, run) -> None:
    path = misbuilt.solved / "results/latest/result.json"
    content = json.loads(path.read_text("utf-8"))
    content["links"][3]["link"] = "tail"
    other = tmp_path / "result.json"
    other.write_text(json.dumps(content), "utf-8")
    code, _, err = run("compare", path, other)
    assert code == 2
    assert "tail" in err


def test_the_limit_keeps_the_false_alarms_of_many_numbers_at_those_of_one() -> None:
    rng = np.random.default_rng(0)
    assert limit_for(1) == pytest.approx(2.0, abs=1e-6)
    largest = np.abs(rng.standard_normal((20_000, 40))).max(axis=1)
    assert np.mean(largest > limit_for(40)) == pytest.approx(0.0455, abs=0.006)
