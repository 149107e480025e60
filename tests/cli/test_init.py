# SPDX-License-Identifier: Apache-2.0
"""``comcal init``: a robot.yaml that loads, passes the check and explains itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from comcal.robot.description import load_robot
from comcal.robot.frames import rotation_from_rpy
from comcal.robot.robot_yaml import _rpy
from comcal_sims.robots import biped14, table1

SENSORS = {
    "talos": ("leg_left_6_joint", "leg_right_6_joint"),
    "g1": ("left_ankle_roll_joint", "right_ankle_roll_joint"),
    "icub": ("l_foot_ft_sensor", "r_foot_ft_sensor"),
    "romeo": ("LAnkleRoll", "RAnkleRoll"),
    "table1": ("l_foot_ft", "r_foot_ft"),
    "biped14": ("l_foot_ft", "r_foot_ft"),
}
IMUS = {
    "talos": "imu_link",
    "g1": "imu_in_torso",
    "icub": "imu_frame",
    "romeo": "ImuTorsoAccelerometer_frame",
}


@pytest.mark.parametrize("name", list(SENSORS))
def test_the_guessed_description_loads_and_passes_the_check(
    name, example_urdf, tmp_path, run
) -> None:
    generated = {"table1": table1.generate, "biped14": biped14.generate}
    if name in generated:
        urdf = generated[name](tmp_path / "robot").with_name(f"{name}.urdf")
    else:
        urdf = example_urdf(name)
    path = tmp_path / "robot.yaml"
    code, out, _ = run("init", path, "--urdf", urdf)
    assert code == 0
    assert out.splitlines()[-1] == f"next: comcal check {path}"
    robot = load_robot(path)
    assert tuple(robot.feet) == ("left", "right")
    joints = tuple(robot.sensors[f.sensor or ""].joint for f in robot.feet.values())
    assert joints == SENSORS[name]
    assert robot.imu_link == IMUS.get(name)
    assert all(foot.ankle for foot in robot.feet.values())
    # The soles are level and the toes are in front, whichever way the root points.
    from comcal.robot.soles import place_at_zero

    at = place_at_zero(robot.tree)
    ahead = []
    for foot in robot.feet.values():
        R = at.link(foot.link)[0][0] @ foot.T_link_sole[:3, :3]
        assert R[2, 2] > 0.999
        ahead.append(R[:, 0])
    assert ahead[0] @ ahead[1] > 0.98
    assert run("check", path)[0] == 0


@pytest.mark.parametrize(("name", "generate"), [("table1", table1), ("biped14", biped14)])
def test_the_generated_robots_are_described_as_their_own_files_do(
    name, generate, tmp_path, run
) -> None:
    own = generate.generate(tmp_path / "robot")
    path = tmp_path / "robot.yaml"
    assert run("init", path, "--urdf", own.with_name(f"{name}.urdf"))[0] == 0
    guessed, written = load_robot(path), load_robot(own)
    for foot in ("left", "right"):
        one, other = guessed.feet[foot], written.feet[foot]
        assert (one.link, one.ankle) == (other.link, other.ankle)
        np.testing.assert_allclose(one.T_link_sole, other.T_link_sole, atol=1e-6)
        np.testing.assert_allclose(
            sorted(np.asarray(one.sole).tolist()),
            sorted(np.asarray(other.sole).tolist()),
            atol=1e-6,
        )


def test_an_arm_gets_a_file_to_fill_in(tmp_path: Path, run) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        '<robot name="arm: 2"><link name="base"/><link name="tip"><inertial><mass value="1"/>'
        '</inertial></link><joint name="on" type="continuous"><parent link="base"/>'
        '<child link="tip"/></joint></robot>',
        "utf-8",
    )
    path = tmp_path / "robot.yaml"
    code, out, _ = run("init", path, "--urdf", urdf)
    assert code == 0
    assert "no legs were found" in out
    assert path.read_text("utf-8").count("FILL IN") == 2
    robot = load_robot(path)
    assert (robot.name, robot.feet) == ("arm: 2", {})


def test_an_existing_file_is_never_overwritten(tmp_path: Path, run) -> None:
    own = table1.generate(tmp_path / "robot")
    before = own.read_bytes()
    code, _, err = run("init", own, "--urdf", own.with_name("table1.urdf"))
    assert code == 2
    assert "exists already" in err
    assert own.read_bytes() == before


def test_json_stands_alone_on_stdout(tmp_path: Path, run) -> None:
    urdf = table1.generate(tmp_path / "robot").with_name("table1.urdf")
    code, out, err = run("init", tmp_path / "new.yaml", "--urdf", urdf, "--json")
    assert (code, err) == (0, "")
    assert [foot["link"] for foot in json.loads(out)["feet"]] == ["l_sole", "r_sole"]


def test_angles_of_a_rotation_give_it_back() -> None:
    rng = np.random.default_rng(1)
    for rpy in [*rng.uniform(-3, 3, (20, 3)), np.array([0.3, np.pi / 2, 0.4])]:
        R = rotation_from_rpy(rpy)
        np.testing.assert_allclose(rotation_from_rpy(_rpy(R)), R, atol=1e-9)
