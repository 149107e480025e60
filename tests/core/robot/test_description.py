# SPDX-License-Identifier: Apache-2.0
"""robot.yaml becomes a robot; every mistake is named with file, line and what was meant."""

from __future__ import annotations

import math

import numpy as np
import pytest

from comcal.errors import ConfigError, UrdfError
from comcal.robot.description import load_robot
from comcal.robot.model import Base, Sense


def test_every_key_of_the_file_reaches_the_robot_in_si(biped):
    robot = load_robot(biped)
    assert (robot.name, robot.gravity, robot.base) == ("small", 9.81, Base.FLOATING)
    assert robot.sensors["l_foot"].sense is Sense.ON_ROBOT
    assert robot.sensors["r_foot"].sense is Sense.ON_GROUND
    assert robot.sensors["r_foot"].below.mass == 0.3
    np.testing.assert_array_equal(robot.sensors["r_foot"].below.com, [0.02, 0.0, -0.02])
    assert robot.plates["floor"].feet == ("left", "right")
    assert robot.motors["l_hip"].torque_constant == 0.115
    assert (robot.motors["r_hip"].torque_constant, robot.motors["r_hip"].sign) == (0.115, -1)
    assert robot.imu_link == "pelvis"
    assert robot.noise.ft_moment == 0.01
    assert robot.noise.encoder == pytest.approx(math.radians(0.02))
    assert robot.noise.revisit == {"ft_force": 0.4}
    assert robot.tolerances.link_mass == 0.005
    assert robot.tolerances.link_com == 0.001
    assert robot.tolerances.other == {"joint_offset": pytest.approx(math.radians(0.04))}
    assert robot.sources == {"can": {"channel": "can0", "rates": [1, 2.5]}}
    assert (robot.limits.com_error, robot.limits.mass_error) == (0.005, 0.5)
    assert robot.yaml_path == biped
    assert robot.urdf_path == biped.parent / "small.urdf"


def test_the_shortest_file_has_the_documented_defaults(biped):
    biped.write_text("format: comcal-robot/1\nname: small\nurdf: small.urdf\nsensors:\nfeet: {}\n")
    robot = load_robot(biped)
    assert (robot.gravity, robot.base, dict(robot.sensors)) == (9.81, Base.FLOATING, {})
    assert (robot.noise.ft_force, robot.noise.ft_moment) == (0.1, 0.01)
    assert robot.limits.com_error is None


def test_feet_are_completed_from_the_urdf(biped):
    foot = load_robot(biped).feet["left"]
    assert foot.ankle == "l_ankle"
    np.testing.assert_allclose(foot.T_link_sole[:3, :3], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(foot.T_link_sole[:3, 3], [0, 0, -0.04], atol=1e-12)
    assert {tuple(c) for c in foot.sole.round(12)} == {
        (0.13, 0.05),
        (0.13, -0.05),
        (-0.07, 0.05),
        (-0.07, -0.05),
    }


def test_what_the_file_says_about_a_foot_wins(biped, biped_yaml):
    given = (
        "{link: l_sole, sensor: l_foot, ankle: l_hip, sole_frame: {xyz: [10 mm, 0, 0], "
        "rpy: [0, 0, 90 deg]}, "
        "sole: [[120 mm, 0.05], [0.12, -0.05], [-0.08, -0.05], [-0.08, 0.05]]}"
    )
    biped.write_text(biped_yaml.replace("{link: l_sole, sensor: l_foot}", given))
    foot = load_robot(biped).feet["left"]
    assert foot.ankle == "l_hip"
    np.testing.assert_allclose(foot.T_link_sole[:3, 3], [0.01, 0, 0])
    np.testing.assert_allclose(foot.T_link_sole[:3, 0], [0, 1, 0], atol=1e-15)
    x, y = foot.sole.T
    assert 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) == pytest.approx(0.2 * 0.1)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        (
            "joint: l_foot_ft,",
            "jont: l_foot_ft,",
            7,
            "unknown key 'jont' in sensors.l_foot; did you mean 'joint'",
        ),
        ("gravity: 9.81", "gravitiy:", 4, "unknown key 'gravitiy'"),
        ("gravity: 9.81", "gravitiy: 9.81", 4, "unknown key 'gravitiy'; did you mean 'gravity'"),
        (
            "revisit: {ft_force",
            "revisit: {ft_forc",
            18,
            "in noise.revisit; did you mean 'ft_force'",
        ),
        ("format: comcal-robot/1", "format: comcal-robot/2", 1, "must be 'comcal-robot/1'"),
        ("name: small\n", "", 1, "key 'name' is missing"),
        ("name: small\n", "name: 7\n", 2, "name: must be a valid string .got 7"),
        ("urdf: small.urdf", "urdf: smal.urdf", 3, "no URDF 'smal.urdf'"),
        ("urdf: small.urdf\n", "", 1, "either `urdf:` or `chain:` .neither"),
        ("gravity: 9.81", "gravity: 9810", 4, "less than or equal to 30"),
        ("gravity: 9.81", "gravity: 9.81 N", 4, "gravity: 'N' is not a unit of acceleration"),
        ("base: floating", "base: flying", 5, "'floating' or 'fixed'"),
        ("sense: on_robot", "sense: robot", 7, "'on_robot' or 'on_ground'"),
        (
            "joint: l_foot_ft",
            "joint: l_foot_tf",
            7,
            "no joint 'l_foot_tf'; did you mean 'l_foot_ft'",
        ),
        (
            "r_foot: {joint: r_foot_ft",
            "r_foot: {joint: l_foot_ft",
            8,
            "used twice, first in line 7",
        ),
        (
            "mass: 300 g",
            "mass: 304 g",
            8,
            r"0.304 kg is not .* 0.3 kg .differs by 0.004 kg, limit 1%",
        ),
        ("mass: 300 g", "mass: 300 mm", 8, "sensors.r_foot.below.mass: 'mm' is not a unit of mass"),
        ("mass: 300 g", "mass: -0.3", 8, "greater than or equal to 0"),
        ("link: l_sole", "link: l_soul", 10, "no link 'l_soul'; did you mean 'l_sole'"),
        ("sensor: l_foot}", "sensor: l_fot}", 10, "no sensor 'l_fot'; did you mean 'l_foot'"),
        (
            "sensor: l_foot}",
            "sensor: r_foot}",
            11,
            "sensor 'r_foot' is used twice, first in line 10",
        ),
        ("{link: r_sole", "{link: l_sole", 11, "link 'l_sole' is used twice"),
        ("sensor: l_foot}", "sole: [[0, 0], [1, 1], [2, 2]]}", 10, "enclose no area"),
        ("sensor: l_foot}", "sole: [[0, 0], [1, 1, 1], [2, 2]]}", 10, r"feet.left.sole\[1\]"),
        ("sensor: l_foot}", "ankle: l_foot_ft}", 10, "an ankle must turn"),
        ("left: {link", "double: {link", 10, "a meaning of its own"),
        ("l_foot: {joint", "l.foot: {joint", 7, "should match pattern"),
        ("feet: [left, right]", "feet: [left, rigth]", 13, "no foot 'rigth'; did you mean 'right'"),
        ("feet: [left, right]", "feet: [left, left]", 13, "foot 'left' is used twice"),
        ("frame: world", "frame: floor", 13, "no frame 'floor'"),
        ("floor: {frame", "l_foot: {frame", 13, "name 'l_foot' is used twice, first in line 7"),
        ("l_hip: {torque", "l_hips: {torque", 15, "no joint 'l_hips'"),
        ("l_hip: {torque", "l_foot_ft: {torque", 15, "is fixed and cannot have a motor"),
        ("sign: 1}", "sign: 2}", 15, "motors.l_hip.sign: must be 1 or -1"),
        ("imu: {link: pelvis}", "imu: {link: pelvs}", 17, "did you mean 'pelvis'"),
        ("ft_force: 0.1,", "ft_force: .nan,", 18, "noise.ft_force: a force must be finite"),
        ("link_mass: 0.5 %", "link_mas: 0.5 %", 19, "did you mean 'link_mass'"),
    ],
)
def test_mistakes_are_named_with_file_line_and_meaning(biped, biped_yaml, old, new, line, message):
    assert biped_yaml.count(old) >= 1
    biped.write_text(biped_yaml.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message) as caught:
        load_robot(biped)
    assert caught.value.where == f"robot.yaml:{line}"


def test_exchanged_sensors_of_the_feet_are_refused(biped, biped_yaml):
    text = biped_yaml.replace("sensor: l_foot}", "sensor: x}")
    text = text.replace("sensor: r_foot}", "sensor: l_foot}").replace(
        "sensor: x}", "sensor: r_foot}"
    )
    biped.write_text(text)
    with pytest.raises(ConfigError, match="look exchanged") as caught:
        load_robot(biped)
    assert caught.value.where == "robot.yaml:11"


def test_override_replaces_the_mass_below_the_cut(biped, biped_yaml):
    biped.write_text(biped_yaml.replace("mass: 300 g,", "mass: 900 g, override: true,"))
    assert load_robot(biped).sensors["r_foot"].below.mass == 0.9


def test_a_broken_urdf_is_named_with_its_own_line(biped):
    (biped.parent / "small.urdf").write_text("<robot>\n<link name='a'/>\n<link name='a'/></robot>")
    with pytest.raises(UrdfError, match=r"small\.urdf:3"):
        load_robot(biped)


def test_a_urdf_given_instead_of_the_yaml_is_recognised(biped):
    with pytest.raises(ConfigError, match="names this file as its"):
        load_robot(biped.parent / "small.urdf")


CHAIN = """\
format: comcal-robot/1
name: human
chain:
  - {name: knee, parent: ankle, axis: -y}
  - {name: ankle, axis: [0, 2, 0]}
  - {name: hip, parent: knee, axis: y}
  - {name: arm, parent: base, axis: x}
"""


def test_a_chain_without_urdf_has_axes_and_no_geometry(write):
    tree = load_robot(write("robot.yaml", CHAIN)).tree
    assert not tree.geometry_known
    assert tree.joint_names == ("ankle", "knee", "hip", "arm")
    assert tree.parents.tolist() == [-1, 0, 1, 2, 0]
    axes = [j.axis.tolist() for j in tree.joints]
    assert axes == [[0, 1, 0], [0, -1, 0], [0, 1, 0], [1, 0, 0]]
    assert np.isnan(tree.masses).all()
    assert all((joint.T_parent_joint == np.eye(4)).all() for joint in tree.joints)


def test_a_chain_may_have_sensors_and_feet(write):
    text = CHAIN + "sensors: {s: {joint: ankle}}\nfeet: {one: {link: base, sensor: s}}\n"
    robot = load_robot(write("robot.yaml", text))
    assert robot.feet["one"].ankle == "ankle"
    assert robot.below_cut["s"].tolist() == [True, False, False, False, True]


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("name: knee", "name: hip", 6, "'hip' is defined twice, first in line 4"),
        ("parent: ankle", "parent: ankel", 4, "did you mean 'ankle'"),
        ("{name: ankle,", "{name: ankle, parent: hip,", 4, "cycle"),
        ("axis: -y", "axis: w", 4, r"chain\[0\].axis: an axis must be one of x, y, z"),
        ("[0, 2, 0]", "[0, 0, 0]", 5, "not all zero"),
        ("[0, 2, 0]", "[0, 1]", 5, "three numbers"),
        ("name: arm", "name: base", 7, "a meaning of its own"),
        ("name: human", "name: human\nurdf: x.urdf", 1, "both are there"),
        ("axis: -y", "axes: -y", 4, r"unknown key 'axes' in chain\[0\]; did you mean 'axis'"),
    ],
)
def test_mistakes_in_a_chain_are_named(write, old, new, line, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load_robot(write("robot.yaml", CHAIN.replace(old, new, 1)))
    assert caught.value.where == f"robot.yaml:{line}"
