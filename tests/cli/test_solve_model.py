# SPDX-License-Identifier: Apache-2.0
"""``solve --model``: a known model in a session's result, and in what is made of that result."""

from __future__ import annotations

import json
import shutil
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from comcal.cli.main import main
from comcal.robot.changes_text import parse_change
from comcal.robot.changes_yaml import KnownChange, extension_text, read_extension
from comcal.robot.urdf import read_urdf
from comcal_sims.robots import biped14

SCHEMA = json.loads(files("comcal.report").joinpath("result.schema.json").read_text("utf-8"))
HIDDEN = {
    "payload@torso:mass=3,com_x=0.05,com_z=0.2": {"mass": 0.05},
    "joint_offset@waist_pitch:offset=0.02": {"offset": 0.0005},
    "tether@torso:force_x=5,k_xx=80": {"force_x": 0.1},
}
FAST = ("--method", "lstsq", "--no-currents", "--held-out", "9,17,25")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two sessions of a robot that hides something; in one it is solved, with the true model."""
    folder = tmp_path_factory.mktemp("model")
    robot = biped14.generate(folder / "robot")
    header, *rows = robot.with_name("plan.csv").read_text("utf-8").splitlines()
    chosen = [row for i, row in enumerate(rows) if i % 2 == 0 and ",none" not in row]
    plan = folder / "plan.csv"
    plan.write_text("\n".join([header, *chosen]) + "\n", "utf-8")
    known = [KnownChange(parse_change(text), sigma) for text, sigma in HIDDEN.items()]
    (folder / "extended.yaml").write_text(extension_text(known), "utf-8")
    for seed in (1, 2):
        words = ["record", str(robot), "-s", str(folder / f"s{seed}"), "--source", "builtin"]
        words += ["--poses", str(plan), "--seed", str(seed)]
        assert main([*words, "--model", str(folder / "extended.yaml")]) == 0
    model = ["--model", str(folder / "extended.yaml")]
    assert main(["solve", str(folder / "s1"), *FAST, *model]) == 0
    return folder


def result_of(session: Path) -> dict:
    return json.loads((session / "results" / "latest" / "result.json").read_text("utf-8"))


def pull(result: dict, urdf: Path) -> float:
    """Largest deviation of a measured component from the URDF, but of the torso, in sigmas."""
    tree = read_urdf(urdf)
    return max(
        abs(link["com"][i] - tree.links[tree.link_index[link["link"]]].com[i])
        / link["cov"][i][i] ** 0.5
        for link in result["links"]
        for i in range(3)
        if link["identifiable"][i] and link["link"] != "torso"
    )


def test_the_result_holds_the_model_and_the_links_under_it(folder) -> None:
    result = result_of(folder / "s1")
    jsonschema.validate(result, SCHEMA)
    model = result["model"]
    assert [e["effect"] for e in model["effects"]] == ["payload", "joint_offset", "tether"]
    assert len(model["sha256"]) == 64
    assert model["shared_errors"] == ["joint_offset@waist_pitch offset", "tether@torso force_x"]
    assert model["exact"] == ["payload@torso mass"]
    assert result["mass"]["model"] == pytest.approx(result["mass"]["urdf"] + 3.0)
    assert result["mass"]["value"] == pytest.approx(67.0, abs=0.02)
    assert result["verdict"] == "passed"
    assert [check["name"] for check in result["checks"]][1] == "mass against the model"
    assert pull(result, folder / "robot" / "biped14.urdf") < 4.0


def test_the_report_names_the_model_before_any_number(folder, tmp_path, run) -> None:
    session = Path(shutil.copytree(folder / "s1", tmp_path / "s", symlinks=True))
    code, out, _ = run("solve", session, *FAST, "--model", folder / "extended.yaml")
    assert code == 0
    words = " ".join(out.split())
    assert words.startswith(f"note: model {folder}/extended.yaml: payload@torso (mass 3 +/- 0.05")
    assert "every sigma contains how well the model knows joint_offset@waist_pitch" in words
    assert "taken as exact, as bodies of the URDF are: payload@torso mass" in words
    assert "67.000 kg in the model" in words
    code, out, _ = run("solve", session, *FAST, "--json")
    assert code == 5
    without = json.loads(out)
    assert "model" not in without
    assert pull(without, folder / "robot" / "biped14.urdf") > 8.0


def test_the_first_pose_anchors_a_tether_even_where_it_is_dropped(folder, tmp_path, run) -> None:
    session = Path(shutil.copytree(folder / "s1", tmp_path / "s", symlinks=True))
    first = result_of(session)["fitted"][0]
    model = ("--model", folder / "extended.yaml")
    code, out, _ = run("solve", session, *FAST, *model, "--drop", first, "--json")
    assert code == 0
    result = json.loads(out)
    assert first not in result["fitted"]
    assert pull(result, folder / "robot" / "biped14.urdf") < 4.0


def test_export_and_compare_need_the_result_alone(folder, tmp_path, run) -> None:
    """The file that the model is from has gone; the other session is solved without it."""
    session = Path(shutil.copytree(folder / "s1", tmp_path / "s", symlinks=True))
    other = Path(shutil.copytree(folder / "s2", tmp_path / "other", symlinks=True))
    gone = tmp_path / "gone.yaml"
    shutil.copy(folder / "extended.yaml", gone)
    assert run("solve", session, *FAST, "--model", gone)[0] == 0
    gone.unlink()
    new, rest = tmp_path / "new.urdf", tmp_path / "rest.yaml"
    code, out, _ = run("export", session, "--urdf", new, "--rest", rest)
    assert code == 0
    words = " ".join(out.split())
    assert "in the URDF: payload@torso" in words
    assert "not in the URDF: joint_offset@waist_pitch: the zero of the encoder" in words
    assert [entry.change.effect for entry in read_extension(rest)] == ["joint_offset", "tether"]
    assert read_urdf(new).total_mass == pytest.approx(67.0, abs=1e-6)
    code, out, _ = run("verify", other, "--urdf", new, "--model", rest, "--json")
    assert code == 0
    verified = json.loads(out)
    assert verified["com_rms_mm"] < 1.0
    assert verified["session_urdf"]["com_rms_mm"] > 3.0

    run("solve", other, *FAST)
    code, out, _ = run("compare", session, other)
    assert code == 5
    assert "solved with different models" in " ".join(out.split())


def test_the_model_alone_goes_onto_the_urdf(folder, tmp_path, run) -> None:
    urdf, nominal = tmp_path / "new.urdf", folder / "robot" / "biped14.urdf"
    arguments = ("export", folder / "s2", "--model", folder / "extended.yaml")
    code, out, _ = run(*arguments, "--urdf", urdf)
    assert code == 0
    assert "nothing was fitted" in " ".join(out.split())
    before, after = read_urdf(nominal), read_urdf(urdf)
    k = before.link_index["torso"]
    moment = before.links[k].mass * before.links[k].com + 3.0 * np.array([0.05, 0.0, 0.2])
    np.testing.assert_allclose(after.links[k].com * after.links[k].mass, moment, atol=1e-6)
    assert sum(a != b for a, b in zip(before.masses, after.masses, strict=True)) == 1
    code, diff, err = run(*arguments, "--dry-run")
    assert (code, diff.count("\n-"), diff.count("\n+")) == (0, 3, 4)
    assert "in the URDF: payload@torso" in err
    code, out, _ = run(*arguments, "--json")
    content = json.loads(out)
    assert content["in_urdf"] == ["payload@torso"]
    assert set(content["elsewhere"]) == {"joint_offset@waist_pitch", "tether@torso"}
    rms = content["session_poses"]["com_rms_mm"]
    assert rms["model"] < 1.0 < rms["urdf"]
    code, _, err = run(*arguments, "--yaml", tmp_path / "new.yaml")
    assert code == 2
    assert "solve with it first" in " ".join(err.split())


def test_a_model_of_another_robot_is_refused(folder, tmp_path, run) -> None:
    path = tmp_path / "other.yaml"
    path.write_text(extension_text([KnownChange(parse_change("payload@head:mass=1"))]), "utf-8")
    code, _, err = run("solve", folder / "s2", "--model", path)
    assert code == 2
    assert "has no link 'head'" in err
    assert run("solve", folder / "s2", "--model", tmp_path / "missing.yaml")[0] == 2
