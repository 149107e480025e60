# SPDX-License-Identifier: Apache-2.0
"""Which topic is which channel, and robot.yaml's words on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from comcal.errors import ConfigError
from comcal.robot.description import load_robot
from comcal_drivers.bags.channels import Channels, choose_channels, match_names
from comcal_drivers.bags.configuration import BagSection, read_configuration
from comcal_drivers.bags.log import BagLog
from comcal_drivers.bags.reader import Topic

WRENCH, JOINTS, IMU, TEMPERATURE, TEXT = (
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/Temperature",
    "std_msgs/msg/String",
)
USUAL = {
    "/ft/left": WRENCH,
    "/ft/right": WRENCH,
    "/joint_states": JOINTS,
    "/imu": IMU,
    "/chatter": TEXT,
}


def chosen(recording: Any, there: Mapping[str, str], robot: Any = None, **options: Any) -> Channels:
    section = BagSection.model_validate(options)
    found = {name: Topic(kind, 7) for name, kind in there.items()}
    return choose_channels(section, found, robot or recording.robot, "walk.bag")


def test_the_usual_names_need_no_configuration(recording: Any) -> None:
    found = chosen(recording, USUAL)
    assert found.wrenches == {"l_foot": "/ft/left", "r_foot": "/ft/right"}
    assert found.joints == ("/joint_states",)
    assert found.imu == "/imu"
    assert found.clock == "l_foot"
    assert found.currents == ()
    ours = {"/ft/l_foot": WRENCH, "/ft/r_foot": WRENCH, "/joint_states": JOINTS}
    ours |= {"/motor_currents": JOINTS, "/temperature/r_foot": TEMPERATURE}
    found = chosen(recording, ours)
    assert found.currents == ("/motor_currents",)
    assert found.temperatures == {"r_foot": "/temperature/r_foot"}
    assert found.imu is None


@pytest.mark.parametrize(
    ("names", "topics", "expected"),
    [
        (["l_foot", "r_foot"], ["/r_foot/ft", "/l_foot/ft"], ["/l_foot/ft", "/r_foot/ft"]),
        (
            ["l_foot", "r_foot"],
            ["/left_foot_ft", "/rightFoot/w"],
            ["/left_foot_ft", "/rightFoot/w"],
        ),
        (["l_foot", "r_foot"], ["/ft/left", "/ft/other"], ["/ft/left", None]),
        (["l_foot", "r_foot"], ["/left/a", "/left/b", "/right"], [None, "/right"]),
        (["l_foot", "l_hand"], ["/left/foot", "/left/hand"], ["/left/foot", "/left/hand"]),
        (["l_foot", "l_hand"], ["/left/one", "/left/two"], [None, None]),
        (["l_foot", "l_hand"], ["/left/foot", "/left/two"], ["/left/foot", "/left/two"]),
        (["foot", "foot_2"], ["/foot_2", "/foot"], ["/foot", "/foot_2"]),
        (["l-foot", "l_foot"], ["/ft/l_foot_2", "/ft/l_foot"], ["/ft/l_foot_2", "/ft/l_foot"]),
    ],
)
def test_names_match_only_where_one_topic_fits(
    names: list[str], topics: list[str], expected: list[str | None]
) -> None:
    found = match_names(names, topics)
    assert [found.get(name) for name in names] == expected
    assert match_names(names, topics[::-1]) == found


@pytest.mark.parametrize(
    ("topics", "options", "words"),
    [
        ({"/ft/a": WRENCH, "/ft/b": WRENCH, "/joint_states": JOINTS}, {}, "wrench of l_foot"),
        ({**USUAL, "/arm/joints": JOINTS, "/joint_states": TEXT}, {}, None),
        (
            {"/ft/left": WRENCH, "/ft/right": WRENCH, "/a": JOINTS, "/b": JOINTS},
            {},
            "more than one topic of type sensor_msgs/msg/JointState could be joints",
        ),
        ({"/ft/left": WRENCH, "/ft/right": WRENCH}, {}, "no topic of type sensor_msgs/msg/Joint"),
        ({**USUAL, "/imu2": IMU, "/imu": TEXT, "/imu3": IMU}, {}, "more than one topic .* imu"),
        (USUAL, {"topics": {"l_foot": "/ft/lefd"}}, "no topic /ft/lefd for l_foot"),
        (USUAL, {"topics": {"l_foot": "/imu"}}, "topic /imu is sensor_msgs/msg/Imu, but l_foot"),
        (
            USUAL,
            {"topics": {"l_foot": "/ft/left", "r_foot": "/ft/left"}},
            "/ft/left is given to two channels",
        ),
        (USUAL, {"topics": {"imu": None}, "clock": "imu"}, "clock 'imu' is not read"),
    ],
)
def test_doubt_is_refused_with_the_topics_that_there_are(
    recording: Any, topics: dict[str, str], options: dict[str, Any], words: str | None
) -> None:
    if words is None:
        assert chosen(recording, topics, **options).joints == ("/arm/joints",)
        return
    with pytest.raises(ConfigError, match=words) as caught:
        chosen(recording, topics, **options)
    if "clock" not in options:
        message = str(caught.value)
        assert message.startswith("walk.bag: ")
        assert all(f"{name} ({kind}, 7)" in message for name, kind in topics.items())


def test_what_is_configured_wins_and_null_leaves_out(recording: Any) -> None:
    topics = {**USUAL, "/ft/left_raw": WRENCH, "/currents": JOINTS}
    given = {"l_foot": "/ft/left_raw", "r_foot": None, "imu": None, "currents": "/currents"}
    found = chosen(recording, topics, topics=given, clock="joints")
    assert found.wrenches == {"l_foot": "/ft/left_raw"}
    assert found.imu is None
    assert found.currents == ("/currents",)
    assert found.clock == "joints"
    del topics["/ft/left_raw"]
    two = chosen(recording, topics, topics={"joints": ["/joint_states", "/currents"]})
    assert two.joints == ("/joint_states", "/currents")


def test_a_robot_without_imu_does_not_read_one(recording: Any) -> None:
    robot = replace(recording.robot, imu_link=None)
    assert chosen(recording, {**USUAL, "/imu2": IMU}, robot).imu is None


def test_the_one_sensor_is_the_one_wrench(recording: Any) -> None:
    sensors = {"arm": recording.robot.sensors["l_foot"]}
    robot = replace(recording.robot, sensors=sensors, feet={}, plates={})
    topics = {"/netft_data": WRENCH, "/joint_states": JOINTS}
    assert chosen(recording, topics, robot).wrenches == {"arm": "/netft_data"}


def test_missing_joints_are_refused_with_the_nearest_name(
    recording: Any, new_bag: Callable[..., Any]
) -> None:
    names = list(recording.robot.tree.joint_names)
    theirs = [name.replace(names[0], f"{names[0]}_joint") for name in names]
    with new_bag() as bag:
        for sensor in recording.robot.sensors:
            bag.wrench(f"/ft/{sensor}", 10**9, [0.0] * 6)
        bag.joints("/joint_states", 10**9, theirs, [0.0] * len(names))
    with pytest.raises(ConfigError, match=f"joint {names[0]} is not in.*'{names[0]}_joint'"):
        BagLog(bag.file, recording.robot, BagSection())
    BagLog(bag.file, recording.robot, BagSection(joint_names={names[0]: f"{names[0]}_joint"}))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("topic: {}", r"robot\.yaml:LINE: unknown key 'topic'; did you mean 'topics'"),
        ("topics: {l_fot: /a}", r":LINE: the robot has no channel 'l_fot'; did you mean 'l_foot'"),
        ("topics: {imu: [/a, /b]}", "can have one topic only"),
        ("topics: {joints: null}", "joint positions cannot be left out"),
        ("clock: joint", "no channel 'joint'; did you mean 'joints'"),
        ("effort: amps", "effort: must be 'current', 'torque' or 'ignore'"),
        ("timeout: 5 mm", "timeout: "),
        ("timeout: 0", "timeout: must be greater than 0"),
        ("units: {force: newton}", "units.force: 'newton' is not a unit of force"),
        ("units: {forces: N}", "unknown key 'forces' in units; did you mean 'force'"),
        ("joint_names: {nose: a}", "no joint 'nose'"),
        ("order: random", "order: must be 'planned' or 'any'"),
        ("effort: current\n    topics: {currents: /a}", "motor currents come from two places"),
    ],
)
def test_mistakes_in_robot_yaml_are_named_with_their_line(
    recording: Any, tmp_path: Path, text: str, words: str
) -> None:
    folder = recording.robot.yaml_path.parent
    before = recording.robot.yaml_path.read_text().rstrip()
    urdf = recording.robot.urdf_path
    path = tmp_path / "robot.yaml"
    path.write_text(f"{before}\nsources:\n  bag:\n    {text}\n".replace(urdf.name, str(urdf)))
    assert folder.is_dir()
    robot = load_robot(path)
    line = before.count("\n") + 4
    with pytest.raises(ConfigError, match=words.replace("LINE", str(line))):
        read_configuration(robot.sources["bag"], robot)


def test_units_may_be_written_with_the_numbers(recording: Any) -> None:
    options = {"timeout": "50 ms", "arrival": "2 deg", "units": {"moment": "N cm"}}
    section = read_configuration(options, recording.robot)
    assert section.timeout == pytest.approx(0.05)
    assert section.arrival == pytest.approx(0.0349, abs=1e-4)
    assert section.units.moment == 0.01
    assert read_configuration(None, recording.robot) == BagSection()
