# SPDX-License-Identifier: Apache-2.0
"""The health check finds each fault put into a healthy robot, and finds none in it."""

from __future__ import annotations

import pytest

from comcal.robot.description import load_robot
from comcal.robot.findings import Level
from comcal.robot.health import check_health
from comcal.robot.standing import side_of


def found(path, level):
    return [f for f in check_health(load_robot(path)) if f.level is level]


def test_a_healthy_biped_has_no_errors_and_no_warnings(biped):
    findings = check_health(load_robot(biped))
    assert {f.level for f in findings} == {Level.INFO}
    said = {(f.what, f.measured) for f in findings}
    assert ("total mass of the URDF", "15.6 kg") in said
    assert ("stands at q = 0", "centre of mass 71 mm inside the soles") in said
    assert ("mass below its cut, which it does not carry", "0.3 kg") in said


ARM = """<link name="stub"/><link name="hand"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="s1" type="continuous"><parent link="pelvis"/><child link="stub"/></joint>
<joint name="s2" type="continuous"><parent link="stub"/><child link="hand"/></joint></robot>"""


@pytest.mark.parametrize(
    ("old", "new", "level", "what", "where"),
    [
        ('<mass value="10"/>', '<mass value="-1"/>', "ERROR", "mass is negative", "link pelvis"),
        ('<mass value="10"/>', '<mass value="0"/>', "WARNING", "mass is zero", "link pelvis"),
        ('ixx="0.1"', 'ixx="-0.1"', "WARNING", "not positive definite", "link pelvis"),
        ('ixx="0.1"', 'ixx="0.3"', "WARNING", "exceeds the sum", "link pelvis"),
        ('"0.02 0 -0.02"', '"20 0 -20"', "WARNING", "far outside", "link l_sole"),
        ('<mass value="10"/>', '<mass value="10000"/>', "WARNING", "hard to believe", "small"),
        ('lower="-1" upper="1"', 'lower="1" upper="-1"', "ERROR", "reversed", "joint l_hip"),
        ('lower="-1" upper="1"', 'lower="0" upper="0"', "WARNING", "no room", "joint l_hip"),
        (
            'lower="-1" upper="1"',
            'lower="0.5" upper="1"',
            "INFO",
            "outside its limits",
            "joint l_hip",
        ),
        (
            '"l_foot_ft" type="fixed"',
            '"l_foot_ft" type="continuous"',
            "WARNING",
            "not fixed",
            "sensor l_foot",
        ),
        ("</robot>", ARM, "WARNING", "no inertial", "link stub"),
        ('xyz="0 0 0.1"', 'xyz="3 0 0.1"', "WARNING", "would fall over", "robot small"),
        ('xyz="0 0 -0.4"', 'xyz="0 0 -0.4" rpy="0 0.1 0"', "INFO", "is not level", "foot left"),
        ('xyz="0 0 -0.4"', 'xyz="0 0 -0.5"', "INFO", "not at one height", "feet left, right"),
        (
            '<origin xyz="0 0.1 0"/>',
            '<origin xyz="0 -0.3 0"/>',
            "WARNING",
            "on the right of the right",
            "robot small",
        ),
        (
            '<child link="l_sole"/>',
            '<child link="l_sole"/><origin/>',
            "WARNING",
            "a second <origin>",
            "",
        ),
    ],
)
def test_each_fault_in_the_urdf_is_found_where_it_is(biped, old, new, level, what, where):
    urdf = biped.parent / "small.urdf"
    assert old in urdf.read_text()
    urdf.write_text(urdf.read_text().replace(old, new, 1))
    hits = [f for f in found(biped, Level[level]) if what in f.what]
    assert [f.where for f in hits] == [where]


LEFT = "left: {link: l_sole, sensor: l_foot}"
RIGHT = "  right: {link: r_sole, sensor: r_foot}\n"
PLATES = "plates:\n  floor: {frame: world, feet: [left, right]}\n"


@pytest.mark.parametrize(
    ("changes", "level", "what", "where"),
    [
        (
            {PLATES: "", LEFT: "left: {link: l_sole}"},
            "WARNING",
            "neither a sensor nor",
            "foot left",
        ),
        ({LEFT: "left: {link: l_sole}"}, "INFO", "belongs to no foot", "sensor l_foot"),
        (
            {
                LEFT: "left: {link: l_sole, sensor: r_foot}",
                RIGHT: "",
                PLATES: "",
                ", below: {mass: 300 g, com: [20 mm, 0, -0.02]}": "",
            },
            "WARNING",
            "more than half",
            "sensor r_foot",
        ),
        (
            {LEFT: "left: {link: r_sole, sensor: r_foot}", RIGHT: "", PLATES: ""},
            "WARNING",
            "is called right",
            "foot left",
        ),
        ({LEFT: "left: {link: pelvis}"}, "INFO", "outline of its sole", "foot left"),
        ({LEFT: "left: {link: l_shin}"}, "INFO", "no pitch joint", "foot left"),
        (
            {LEFT: "left: {link: l_sole, sensor: l_foot, sole_frame: {rpy: [180 deg, 0, 0]}}"},
            "WARNING",
            "points up",
            "foot left",
        ),
    ],
)
def test_each_fault_in_the_yaml_is_found_where_it_is(
    biped, biped_yaml, changes, level, what, where
):
    text = biped_yaml
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    biped.write_text(text)
    assert where in [f.where for f in found(biped, Level[level]) if what in f.what]


def test_errors_come_before_warnings_before_the_rest(biped):
    urdf = biped.parent / "small.urdf"
    text = urdf.read_text().replace('lower="-1" upper="1"', 'lower="1" upper="-1"')
    urdf.write_text(text.replace('ixx="0.1"', 'ixx="0.3"'))
    levels = [f.level for f in check_health(load_robot(biped))]
    order = [Level.ERROR, Level.WARNING, Level.INFO]
    assert levels == sorted(levels, key=order.index)
    assert set(levels) == set(order)


def test_a_chain_without_urdf_is_not_judged_by_masses_it_does_not_have(write):
    text = "format: comcal-robot/1\nname: c\nchain: [{name: a, axis: y}]\n"
    findings = check_health(load_robot(write("robot.yaml", text)))
    assert [(f.level, f.where) for f in findings] == [(Level.INFO, "c")]


@pytest.mark.parametrize(
    ("name", "side"),
    [
        ("left", "left"),
        ("l_sole", "left"),
        ("LeftFoot", "left"),
        ("foot_r", "right"),
        ("RFoot", "right"),
        ("sole", ""),
        ("rl_foot", ""),
        ("left_of_right", ""),
    ],
)
def test_sides_are_read_from_names(name, side):
    assert side_of(name) == side
