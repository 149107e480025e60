# SPDX-License-Identifier: Apache-2.0
"""``comcal export``: the model that is handed back predicts what was measured, and says why."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from comcal.robot.urdf import read_urdf


@pytest.fixture(scope="module")
def exported(misbuilt, tmp_path_factory) -> Path:
    from comcal.cli.main import main

    folder = tmp_path_factory.mktemp("exported")
    arguments = ["--urdf", str(folder / "new.urdf"), "--yaml", str(folder / "new.yaml")]
    assert main(["export", str(misbuilt.solved), *arguments, "--c", str(folder / "c")]) == 0
    return folder


def test_fresh_poses_are_predicted_several_times_better(misbuilt, exported, run) -> None:
    rms = {}
    for name, urdf in (("new", exported / "new.urdf"), ("old", misbuilt.nominal)):
        _, out, _ = run("verify", misbuilt.fresh, "--urdf", urdf, "--json")
        rms[name] = json.loads(out)["com_rms_mm"]
    assert rms["old"] > 3.0
    assert rms["new"] < rms["old"] / 5


def test_scaled_masses_pass_every_limit_on_fresh_poses(misbuilt, tmp_path, run) -> None:
    urdf = tmp_path / "scaled.urdf"
    assert run("export", misbuilt.solved, "--scale-masses", "--urdf", urdf)[0] == 0
    code, out, _ = run("verify", misbuilt.fresh, "--urdf", urdf)
    assert code == 0, out
    assert "Verdict: PASSED" in out
    new, old = read_urdf(urdf), read_urdf(misbuilt.nominal)
    ratio = new.masses / old.masses
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-7)
    assert new.total_mass == pytest.approx(read_urdf(misbuilt.true).total_mass, abs=0.02)


def test_only_numbers_of_origins_change(misbuilt, exported) -> None:
    number = rb'(?<=<origin xyz=")[^"]*(?=" rpy="0 0 0" />\n      <mass)'
    new, old = (exported / "new.urdf").read_bytes(), misbuilt.nominal.read_bytes()
    assert new != old
    assert re.sub(number, b"", new) == re.sub(number, b"", old)


def test_the_yaml_says_where_each_number_is_from(misbuilt, exported) -> None:
    content = YAML(typ="safe", pure=True).load((exported / "new.yaml").read_text("utf-8"))
    assert content["format"] == "comcal-model/1"
    assert set(content["sha256"]) == {"robot.yaml", "poses.csv", "biped14.urdf"}
    result = json.loads((misbuilt.solved / "results/latest/result.json").read_text("utf-8"))
    sources = {link["link"]: link["source"] for link in result["links"]}
    tree = read_urdf(exported / "new.urdf")
    nominal = read_urdf(misbuilt.nominal)
    for link, before in zip(tree.links, nominal.links, strict=True):
        entry = content["links"][link.name]
        assert entry["provenance"] == [source or "prior" for source in sources[link.name]]
        np.testing.assert_allclose(entry["com"], link.com, atol=1e-8)
        np.testing.assert_array_equal(entry["urdf_com"], np.round(before.com, 9))
        assert entry["frame"] == link.name
        assert all(sigma > 0.0 for sigma in entry["sigma"])
        for axis in range(3):
            if entry["provenance"][axis] == "prior":
                assert link.com[axis] == before.com[axis]
    assert content["links"]["torso"]["provenance"] == ["measured", "combination", "measured"]
    assert "below the cut" in content["links"]["l_sole"]["kept"]


def test_the_c_code_is_that_of_the_new_model(exported, tmp_path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    sources = sorted(str(path) for path in (exported / "c").glob("*.c"))
    program = tmp_path / "test"
    subprocess.run([compiler, "-std=c99", *sources, "-lm", "-o", str(program)], check=True)
    subprocess.run([str(program)], check=True)


def test_a_dry_run_prints_a_patch_and_writes_nothing(misbuilt, exported, tmp_path, run) -> None:
    target = tmp_path / "new.urdf"
    code, out, err = run("export", misbuilt.solved, "--dry-run", "--urdf", target)
    assert code == 0
    assert not target.exists()
    assert "CoM of each link" in err
    if shutil.which("patch") is None:
        pytest.skip("no patch")
    shutil.copy(misbuilt.nominal, target)
    subprocess.run(["patch", "-s", str(target)], input=out, text=True, check=True)
    assert target.read_bytes() == (exported / "new.urdf").read_bytes()


def test_nothing_is_overwritten(misbuilt, exported, tmp_path, run) -> None:
    urdf = exported / "new.urdf"
    before = urdf.read_bytes()
    code, _, err = run("export", misbuilt.solved, "--yaml", tmp_path / "new.yaml", "--urdf", urdf)
    assert code == 2
    assert "exists already" in err
    assert urdf.read_bytes() == before
    assert not (tmp_path / "new.yaml").exists()


def test_a_session_without_a_current_result_is_refused(misbuilt, tmp_path, run) -> None:
    session = Path(shutil.copytree(misbuilt.solved, tmp_path / "s", symlinks=True))
    with (session / "poses.csv").open("a", encoding="utf-8") as file:
        file.write("\n")
    code, _, err = run("export", session)
    assert code == 2
    assert "poses.csv changed since the newest result" in err
    shutil.rmtree(session / "results")
    code, _, err = run("export", session)
    assert code == 2
    assert "comcal solve" in err


def test_json_stands_alone_on_stdout(misbuilt, run) -> None:
    code, out, err = run("export", misbuilt.solved, "--json")
    assert code == 0
    content = json.loads(out)
    assert err == ""
    assert content["files"] == []
    rms = content["session_poses"]["com_rms_mm"]
    assert rms["exported"] < rms["urdf"] / 5


def test_poses_that_were_left_out_of_the_result_are_left_out_of_the_model(
    misbuilt, tmp_path, run
) -> None:
    session = Path(shutil.copytree(misbuilt.fresh, tmp_path / "s", symlinks=True))
    arguments = ["--no-currents", "--method", "lstsq", "--drop", "3", "--drop", "20"]
    assert run("solve", session, *arguments)[0] in (0, 5)
    code, out, err = run("export", session, "--json")
    assert code == 0, err
    assert json.loads(out)["session_poses"]["poses"] == 35


def test_the_papers_route_alone_has_no_links_to_export(misbuilt, tmp_path, run) -> None:
    session = Path(shutil.copytree(misbuilt.fresh, tmp_path / "s", symlinks=True))
    path = session / "results/latest/result.json"
    content = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**content, "links": []}), "utf-8")
    code, _, err = run("export", session)
    assert code == 2
    assert "paper's route alone" in err
