# SPDX-License-Identifier: Apache-2.0
"""``comcal check`` says what it understood, finds what is wrong, and ends in one verdict."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from comcal.cli.main import main

LEG = """
  <joint name="{s}_ankle" type="revolute">
    <parent link="torso"/><child link="{s}_foot"/><origin xyz="0 {y} -0.3"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="50" velocity="1"/>
  </joint>
  <link name="{s}_foot"><inertial><origin xyz="0 0 -0.02"/><mass value="1.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{s}_ft" type="fixed">
    <parent link="{s}_foot"/><child link="{s}_sole"/><origin xyz="0 0 -0.05"/>
  </joint>
  <link name="{s}_sole">
    <inertial><origin xyz="0 0 -0.01"/><mass value="0.25"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision>
      <origin xyz="0.02 0 -0.01"/><geometry><box size="0.2 0.1 0.02"/></geometry>
    </collision>
  </link>
"""

URDF = """<robot name="small">
  <link name="torso"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  {legs}
</robot>
"""

ROBOT = """format: comcal-robot/1
name: small
urdf: small.urdf
sensors:
  l_foot: {joint: l_ft}
  r_foot: {joint: r_ft, sense: on_ground}
feet:
  left: {link: l_sole, sensor: l_foot}
  right: {link: r_sole, sensor: r_foot}
motors:
  l_ankle: {torque_constant: 0.1, gear: 50, sign: -1}
limits: {com_error: 5 mm}
"""

EXPECTED = """\
robot    small (robot.yaml, small.urdf)
body     13.500 kg, 5 links, floating base, gravity 9.81 m/s^2
joints   2: l_ankle, r_ankle
motors   l_ankle=-5 N m/A; none for r_ankle
imu      none
limits   CoM error 5 mm
engines  (what is installed)

sensor  at joint  its wrench is  below its cut  kg     above the sole
l_foot  l_ft      on_robot       l_sole         0.250  20.0 mm
r_foot  r_ft      on_ground      r_sole         0.250  20.0 mm

foot   link    measured by  sole          ankle
left   l_sole  l_foot       200 x 100 mm  l_ankle
right  r_sole  r_foot       200 x 100 mm  r_ankle

"""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A robot of two feet under a torso, in a folder of its own."""
    legs = LEG.format(s="l", y=0.1) + LEG.format(s="r", y=-0.1)
    (tmp_path / "small.urdf").write_text(URDF.format(mass=10.0, legs=legs))
    (tmp_path / "robot.yaml").write_text(ROBOT)
    return tmp_path / "robot.yaml"


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_report_of_a_healthy_robot(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(robot)]) == 0
    out = capsys.readouterr().out
    facts, findings = out.split("\nnote: ", 1)
    facts = re.sub(
        r"^engines  .*\n( .*\n)*", "engines  (what is installed)\n", facts, flags=re.MULTILINE
    )
    assert facts + "\n" == EXPECTED
    assert findings.splitlines()[-1] == "usable: 0 errors, 0 warnings"


def test_warning_leaves_the_robot_usable(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace(
        robot.with_name("small.urdf"), 'ixx="0.1" iyy="0.1" izz="0.1"', 'ixx="0" iyy="1" izz="1"'
    )
    assert main(["check", str(robot)]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^warning: link torso: .*inertia.*; ", out, re.MULTILINE)
    assert out.splitlines()[-1] == "usable: 0 errors, 1 warning"


def test_impossible_description_exits_3(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace(robot.with_name("small.urdf"), 'value="1.5"', 'value="-1.5"')
    assert main(["check", str(robot)]) == 3
    out = capsys.readouterr().out
    assert "error: link l_foot: the mass is negative (-1.5 kg, limit 0 kg)" in out
    assert out.splitlines()[-1].startswith("not usable: 2 errors, ")


def test_wrong_file_exits_2_with_one_line(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace(robot, "joint: l_ft", "jiont: l_ft")
    assert main(["check", str(robot)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: robot.yaml:5: ")
    assert "did you mean 'joint'?" in err
    assert err.count("\n") == 1


def test_missing_file_exits_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(tmp_path / "nothing.yaml")]) == 2
    assert "nothing.yaml: there is no such file" in capsys.readouterr().err


def test_mass_given_below_the_cut_replaces_that_of_the_urdf(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replace(robot, "{joint: l_ft}", "{joint: l_ft, below: {mass: 0.251, com: [0, 0, -0.01]}}")
    assert main(["check", str(robot)]) == 0
    assert re.search(r"l_sole +0\.251 \(given\)", capsys.readouterr().out)


def test_json_says_the_same_in_si_units(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(robot), "--json"]) == 0
    out, err = capsys.readouterr()
    result = json.loads(out)
    assert err == ""
    assert result["format"] == "comcal-check/1"
    assert result["verdict"] == "usable"
    assert result["mass"] == pytest.approx(13.5)
    left, right = result["sensors"]
    assert left["below"]["links"] == ["l_sole"]
    assert left["below"]["mass"] == pytest.approx(0.25)
    assert left["below"]["height"] == pytest.approx(0.02)
    assert (left["sense"], right["sense"]) == ("on_robot", "on_ground")
    assert result["feet"][0]["ankle"] == "l_ankle"
    assert result["motors"] == [{"joint": "l_ankle", "torque_per_ampere": pytest.approx(-5.0)}]


def test_chain_without_urdf_has_no_mass_and_no_nan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chain = "[{name: a, axis: y}, {name: b, parent: a, axis: z}]"
    (tmp_path / "robot.yaml").write_text(f"format: comcal-robot/1\nname: arm\nchain: {chain}\n")
    assert main(["check", str(tmp_path / "robot.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mass"] is None
    assert main(["check", str(tmp_path / "robot.yaml")]) == 0
    assert "unknown mass" in capsys.readouterr().out
