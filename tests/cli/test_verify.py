# SPDX-License-Identifier: Apache-2.0
"""``comcal verify``: a model is judged on measured poses without fitting anything."""

from __future__ import annotations

import json
import re

import pytest


def test_the_true_model_passes_and_the_nominal_one_fails(misbuilt, run) -> None:
    code, out, _ = run("verify", misbuilt.fresh, "--urdf", misbuilt.true)
    assert code == 0
    assert "Verdict: PASSED" in out
    code, out, _ = run("verify", misbuilt.fresh, "--urdf", misbuilt.nominal)
    assert code == 5
    assert "mass against the URDF: 1.02 kg > 0.5 kg" in out


def test_json_holds_every_pose(misbuilt, run) -> None:
    code, out, err = run("verify", misbuilt.fresh, "--urdf", misbuilt.true, "--json")
    assert (code, err) == (0, "")
    content = json.loads(out)
    assert content["verdict"] == "passed"
    errors = [pose["com_mm"] for pose in content["poses"]]
    assert content["com_rms_mm"] == pytest.approx((sum(e * e for e in errors) / len(errors)) ** 0.5)
    assert content["com_rms_mm"] < 0.6 < content["session_urdf"]["com_rms_mm"] / 4
    assert content["mass"]["value"] == pytest.approx(content["mass"]["urdf"], abs=0.02)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('joint name="l_knee" type="revolute"', 'joint name="knie" type="revolute"', "'l_knee'"),
        (
            'joint name="l_knee" type="revolute"',
            'joint name="l_knee" type="continuous"',
            "is continuous, not revolute",
        ),
    ],
)
def test_another_mechanism_is_refused_with_the_difference(
    old, new, said, misbuilt, tmp_path, run
) -> None:
    urdf = tmp_path / "other.urdf"
    urdf.write_text(misbuilt.nominal.read_text("utf-8").replace(old, new), "utf-8")
    code, _, err = run("verify", misbuilt.fresh, "--urdf", urdf)
    assert code == 2
    assert said in err


def test_joints_placed_otherwise_are_told(misbuilt, tmp_path, run) -> None:
    text = misbuilt.true.read_text("utf-8")
    moved = re.sub(r'(<child link="torso" />\s*<origin xyz=")0 0 0', r"\g<1>0 0 0.001", text)
    assert moved != text
    urdf = tmp_path / "moved.urdf"
    urdf.write_text(moved, "utf-8")
    _, out, _ = run("verify", misbuilt.fresh, "--urdf", urdf)
    assert "placed otherwise than in the session's URDF: waist_pitch" in out
