# SPDX-License-Identifier: Apache-2.0
"""``sources.can`` of robot.yaml: what it becomes, and how mistakes in it are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.robot.description import load_robot
from comcal.robot.frames import rotation_from_rpy
from comcal_drivers.devices.configuration import CanConfig, read_configuration
from comcal_drivers.devices.description import load_description, load_device
from comcal_drivers.devices.tables import bus_table
from comcal_drivers.join.joiner import joiner_for

INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINKS = "".join(
    f'<link name="{name}"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
    for name in ("trunk", "shank", "foot")
)
JOINTS = "".join(
    f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
    '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    for name, parent, child in (("knee", "trunk", "shank"), ("ankle", "shank", "foot"))
)
HEAD = """\
format: comcal-robot/1
name: leg
urdf: leg.urdf
sensors:
  foot_ft: {joint: ankle}
imu: {link: trunk}
motors:
  knee: {torque_constant: 0.1, gear: 80}
sources:
  can:
    buses:
      can0: {interface: socketcan, channel: can0, bitrate: 1000000}
      usb: {interface: slcan, channel: /dev/ttyACM0, bitrate: 500000, rtscts: true}
"""
BODY = """\
    sensors:
      foot_ft:
        bus: can0
        device: ati_netcanoem
        ids: {base: 0x7F}
        period: 1 ms
        timeout: 20 ms
        ignore_status: [14]
        rotate: [0, 0, 90 deg]
    joints:
      knee:
        bus: usb
        device: maxon_epos
        ids: {node: 3}
        counts_per_turn: 2048
        sign: -1
        zero: 5 deg
"""
FIRST_LINE = HEAD.count("\n") + 1
"""Line on which BODY begins."""

Read = Callable[[str], CanConfig]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    (tmp_path / "leg.urdf").write_text(f'<robot name="leg">{LINKS}{JOINTS}</robot>')

    def configure(body: str) -> CanConfig:
        (tmp_path / "robot.yaml").write_text(HEAD + body)
        robot = load_robot(tmp_path / "robot.yaml")
        return read_configuration(robot.sources["can"], robot)

    return configure


@pytest.mark.parametrize(
    ("device", "period", "apart"),
    [
        ("iit_strain", "10 ms", 0.005),
        ("sunrise_m8123", "10 ms", 0.005),
        ("robotous_rft", "10 ms", 0.005),
        ("iit_strain", "1 s", 0.05),  # no longer than the time-out
        ("jr3_uc3m", "10 ms", 0.05),  # a counter proves more
        ("ati_netcanoem", "10 ms", 0.05),  # and so does the request
        ("optoforce", "10 ms", 0.05),  # and the checksum
    ],
)
def test_parts_that_only_their_order_tells_apart_are_half_a_period_apart_at_most(
    read: Read, device: str, period: str, apart: float
) -> None:
    sensor = f"{{bus: can0, device: {device}, period: {period}, timeout: 50 ms}}"
    config = read(f"    sensors:\n      foot_ft: {sensor}\n")
    assert config.sensors["foot_ft"].apart == pytest.approx(apart)


@pytest.mark.parametrize(
    ("more", "timeout"),
    [("", 0.05), (", sync_period: 10 ms", 0.2), (", sync_period: 10 ms, timeout: 30 ms", 0.03)],
)
def test_what_this_computer_asks_for_may_come_as_late_as_it_asks(
    read: Read, more: str, timeout: float
) -> None:
    drive = f"{{bus: usb, device: maxon_epos, ids: {{node: 3}}, counts_per_turn: 2048{more}}}"
    assert read(f"    joints:\n      knee: {drive}\n").joints["knee"].timeout == timeout


def test_a_polled_sensor_may_be_late_but_its_halves_not_further_apart(read: Read) -> None:
    sensor = "{bus: can0, device: ati_netcanoem, period: 10 ms}"
    config = read(f"    sensors:\n      foot_ft: {sensor}\n").sensors["foot_ft"]
    assert (config.timeout, config.apart) == (0.2, 0.05)


def test_everything_that_is_said_arrives_in_si(read: Read) -> None:
    config = read(BODY)
    assert config.buses["usb"].channel == "/dev/ttyACM0"
    assert config.buses["usb"].options == {"rtscts": True}
    sensor, joint = config.sensors["foot_ft"], config.joints["knee"]
    assert (sensor.period, sensor.timeout, sensor.apart) == (0.001, 0.02, 0.02)
    assert sensor.device.relocate(0) == 0x7F0
    assert sensor.ignore_status == (14,)
    assert sensor.ignore_where == f"robot.yaml:{FIRST_LINE + 7}"
    R = rotation_from_rpy(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(sensor.R_sensor_device, R, atol=1e-15)
    assert sensor.start == sensor.device.description.start
    assert (joint.counts_per_turn, joint.sign) == (2048.0, -1)
    assert joint.zero == pytest.approx(np.deg2rad(5.0))
    assert joint.gear == 80.0  # of the motor, where it is not said again
    assert joint.timeout == joint.device.description.join.timeout
    assert config.clock == "foot_ft"
    assert [d.name for d in config.devices("usb")] == ["knee"]
    assert [d.name for d in config.every_device] == ["foot_ft", "knee"]
    assert joiner_for(sensor, bus_table(sensor.device)).parts == 2


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("device: ati_netcanoem", "device: ati_netcan", 3, "did you mean 'ati_netcanoem'"),
        ("ids: {base: 0x7F}", "ids: {bsae: 0x7F}", 4, "did you mean 'base'"),
        ("ids: {base: 0x7F}", "ids: {base: 0x80}", 4, r"0x80, limit 0 to 0x7f"),
        ("bus: can0", "bus: can1", 2, "did you mean 'can0'"),
        ("  foot_ft:", "  foot_tf:", 1, "no sensor 'foot_tf'; did you mean 'foot_ft'"),
        ("knee:", "kne:", 10, "no joint 'kne'; did you mean 'knee'"),
        ("period: 1 ms", "perod: 1 ms", 5, "unknown key 'perod'.*did you mean 'period'"),
        ("period: 1 ms", "period: 1 mm", 5, "not a unit of time"),
        ("ignore_status: [14]", "ignore_status: [20]", 7, "no status bit 20.*its bits are 0, 1"),
        ("sign: -1", "sign: 2", 15, "sign"),
        ("counts_per_turn: 2048", "gear: 2", 10, "`counts_per_turn` is missing"),
        ("counts_per_turn: 2048", "counts_per_turn: 0", 14, "greater than 0"),
        ("device: maxon_epos", "device: iit_strain", 12, "kind force_torque, not drive"),
        ("rotate: [0, 0, 90 deg]", "rotate: [0, 0]", 8, "rotate"),
        ("rotate: [0, 0, 90 deg]", "matrix: [[1, 2], [3, 4]]", 8, r"2 x 2, limit 6 x 6"),
        ("rotate: [0, 0, 90 deg]", "matrix: m.txt", 8, "no file 'm.txt'"),
        ("rotate: [0, 0, 90 deg]", "bias: [1, 2, 3]", 8, "3 numbers, limit 6"),
        ("rotate: [0, 0, 90 deg]", "settings: {slut: 1}", 8, "did you mean 'slot'"),
        ("rotate: [0, 0, 90 deg]", "start: [matrx]", 8, "did you mean 'matrix'"),
        ("rotate: [0, 0, 90 deg]", "signs: [1, 1, 1, 1, 1, 0]", 8, "signs"),
        ("sign: -1", "ranges: {position: [-1, 1]}", 15, "no range 'position'"),
        ("sign: -1", "dcf: epos.dcf", 15, "no file 'epos.dcf'"),
    ],
)
def test_mistakes_are_refused_with_their_line(
    read: Read, old: str, new: str, line: int, words: str
) -> None:
    assert old in BODY
    with pytest.raises(ConfigError, match=rf"^robot\.yaml:{FIRST_LINE + line}: .*{words}"):
        read(BODY.replace(old, new))


def test_two_devices_with_one_identifier_are_refused(read: Read) -> None:
    ankle = "      ankle: {bus: usb, device: maxon_epos, ids: {node: 3}, counts_per_turn: 4}\n"
    with pytest.raises(ConfigError, match="knee and ankle both send with the identifier 0x183"):
        read(BODY + ankle)
    assert read(BODY + ankle.replace("node: 3", "node: 4")).joints["ankle"].gear == 1.0
    assert read(BODY + ankle.replace("usb", "can0")).joints["ankle"].gear == 1.0


def test_motors_that_share_an_identifier_by_design_are_not_refused(read: Read) -> None:
    motors = "".join(
        f"      {name}: {{bus: usb, device: mit_ak, ids: {{motor: {k}}}}}\n"
        for k, name in enumerate(("knee", "ankle"), 1)
    )
    config = read("    joints:\n" + motors)
    assert {j.device.offset for j in config.joints.values()} == {0}
    with pytest.raises(ConfigError, match="both send with the identifier"):
        read("    joints:\n" + motors.replace("motor: 2", "motor: 1"))


def test_clock_is_a_device_that_exists(read: Read) -> None:
    assert read(BODY + "    clock: knee\n").clock == "knee"
    with pytest.raises(ConfigError, match="no device 'kneee'; did you mean 'knee'"):
        read(BODY + "    clock: kneee\n")
    with pytest.raises(ConfigError, match="no sensor and no joint is configured"):
        read("    sensors: {}\n")


def test_a_matrix_may_stand_in_a_file(read: Read, tmp_path: Path) -> None:
    matrix = np.arange(36.0).reshape(6, 6)
    np.savetxt(tmp_path / "m.txt", matrix, header="of the calibration sheet")
    config = read(BODY.replace("rotate: [0, 0, 90 deg]", "matrix: m.txt"))
    np.testing.assert_array_equal(config.sensors["foot_ft"].matrix, matrix)
    (tmp_path / "m.txt").write_text("1 2 three\n")
    with pytest.raises(ConfigError, match="no matrix of numbers"):
        read(BODY.replace("rotate: [0, 0, 90 deg]", "matrix: m.txt"))


def test_options_without_a_file_are_refused_by_their_keys(read: Read, tmp_path: Path) -> None:
    read(BODY)
    robot = replace(load_robot(tmp_path / "robot.yaml"), yaml_path=None)
    options = {
        "buses": {"can0": {"interface": "virtual"}},
        "sensors": {"foot_ft": {"bus": "can1", "device": "ati_netcanoem"}},
    }
    with pytest.raises(ConfigError, match=r"^sources\.can\.sensors\.foot_ft\.bus: .*'can0'"):
        read_configuration(options, robot)


def test_an_own_device_is_a_file_beside_robot_yaml(read: Read, tmp_path: Path) -> None:
    shipped = load_device("sunrise_m8123")
    text = shipped.dbc.with_suffix(".yaml").read_text()
    (tmp_path / "mine.yaml").write_text(text.replace("name: sunrise_m8123", "name: mine"))
    (tmp_path / "mine.dbc").write_text(shipped.dbc.read_text())
    body = "    sensors:\n      foot_ft: {bus: can0, device: mine.yaml, ids: {offset: 16}}\n"
    sensor = read(body).sensors["foot_ft"]
    assert sensor.device.description.name == "mine"
    assert set(bus_table(sensor.device).messages) == {0x2A1, 0x2A2, 0x2A3}
    (tmp_path / "mine.yaml").write_text(text.replace("values:", "vaules:"))
    with pytest.raises(ConfigError, match=r"^mine\.yaml:\d+: .*did you mean 'values'"):
        read(body)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rule: fifo", "rule: counter", "needs `signal` and `modulus`"),
        ("rule: fifo", "rule: concatenate", "`message` belongs to the rule concatenate"),
        ("kind: force_torque", "kind: drive", "lacks the section 'drive'"),
        ("start: [start]", "start: [strat]", "no command 'strat'.*did you mean 'start'"),
        ("fz, tx, ty, tz]", "fz]", "3 values need 3 `channels`"),
        ("bitrate: 1000000", "bitrate: fast", "bitrate"),
    ],
)
def test_contradictions_in_a_device_file_are_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = load_device("sunrise_m8123").dbc.with_suffix(".yaml").read_text()
    assert old in text
    (tmp_path / "d.yaml").write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=rf"^d\.yaml:\d+: .*{words}"):
        load_description(tmp_path / "d.yaml")
