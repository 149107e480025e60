# SPDX-License-Identifier: Apache-2.0
"""From robot.yaml to drives that stand ready: what is refused before anything gets power."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from comcal.errors import ComcalError, ConfigError, HardwareError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import CommanderRequest
from comcal.robot.description import load_robot
from comcal_drivers.commanders.open_cia402 import open_cia402

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <joint name="knee" type="revolute"><parent link="upper"/><child link="lower"/>
    <axis xyz="0 1 0"/><limit lower="-0.5" upper="0.5" effort="10" velocity="1"/></joint>
</robot>"""

DRIVE = "device: maxon_epos, bus: can0, counts_per_turn: 2000, gear: 20"
PLAN = (PlannedPose(1, np.array([0.2, -0.1])), PlannedPose(2, np.array([-0.2, 0.1])))
RPM_BEHIND_GEAR = 2.0 * math.pi / 60.0 / 20.0

Ask = Callable[..., CommanderRequest]


@pytest.fixture
def ask(tmp_path: Path, channel: str) -> Ask:
    """Write robot.yaml, and make the request that `comcal record` would."""

    def make(
        *,
        hip: str = f"{{{DRIVE}, ids: {{node: 1}}}}",
        knee: str = f"{{{DRIVE}, ids: {{node: 2}}, sign: -1}}",
        interface: str = "virtual",
        more: str = "",
        options: Mapping[str, object] | None = None,
        speed: float = 0.5,
        plan: tuple[PlannedPose, ...] = PLAN,
    ) -> CommanderRequest:
        (tmp_path / "arm.urdf").write_text(URDF)
        joints = {"hip": hip, "knee": knee}
        lines = [f"      {name}: {text}" for name, text in joints.items() if text]
        (tmp_path / "robot.yaml").write_text(
            "format: comcal-robot/1\nname: arm\nurdf: arm.urdf\nbase: fixed\nsources:\n  can:\n"
            f"    buses: {{can0: {{interface: {interface}, channel: {channel}}}}}\n"
            "    joints:\n" + "\n".join(lines) + f"\n{more}"
        )
        robot = load_robot(tmp_path / "robot.yaml")
        return CommanderRequest(robot=robot, plan=plan, options=options or {}, speed=speed)

    return make


def test_robot_yaml_leads_to_a_robot_that_moves(start_drive: Callable, ask: Ask):
    drives = [start_drive(k, counts_per_second=2000.0 / 60.0) for k in (1, 2)]
    commander = open_cia402(ask())
    try:
        assert [d.words for d in drives] == [[], []]
        commander.move_to(PLAN[0])
        deadline = time.monotonic() + 3.0
        while commander.is_moving and time.monotonic() < deadline:
            time.sleep(0.01)
        assert commander.failure is None
        counts_per_radian = 2000 * 20 / math.tau
        assert drives[0].counts == round(0.2 * counts_per_radian)
        assert drives[1].counts == round(0.1 * counts_per_radian)
        # 0.5 rad/s at the joint, told in rpm of the motor and rounded down.
        assert drives[0].number(0x6081) == math.floor(0.5 / RPM_BEHIND_GEAR)
    finally:
        commander.close()


def refused(request: CommanderRequest) -> ComcalError:
    with pytest.raises(ComcalError) as caught:
        open_cia402(request).close()
    return caught.value


def test_a_drive_that_would_let_go_is_refused_unless_it_is_told_otherwise(
    start_drive: Callable, ask: Ask
):
    drives = [start_drive(1), start_drive(2)]
    drives[1].local.set_data(0x605A, 0, (2).to_bytes(2, "little"))
    error = refused(ask())
    assert isinstance(error, HardwareError)
    assert "knee (node 2)" in str(error)
    assert "0x605A" in str(error)
    open_cia402(ask(options={"quick_stop": 6})).close()
    assert drives[1].number(0x605A) == 6


def test_a_drive_without_quick_stop_options_holds(start_drive: Callable, ask: Ask):
    for node in (1, 2):
        start_drive(node, leave_out=(0x605A,))
    open_cia402(ask()).close()


def test_the_unit_of_velocities_is_asked_or_stated_but_never_guessed(
    start_drive: Callable, ask: Ask
):
    start_drive(1)
    start_drive(2, leave_out=(0x608B, 0x608C))
    error = refused(ask())
    assert isinstance(error, ConfigError)
    assert "knee (node 2)" in str(error)
    assert "velocity_unit" in str(error)
    open_cia402(ask(options={"joints": {"knee": {"velocity_unit": "counts/s"}}})).close()
    contradicted = refused(ask(options={"velocity_unit": "counts/s"}))
    assert isinstance(contradicted, HardwareError)
    assert "hip (node 1)" in str(contradicted)


def test_a_power_of_ten_on_the_unit_counts(start_drive: Callable, ask: Ask):
    for node in (1, 2):
        start_drive(node).local.set_data(0x608B, 0, b"\xfd")  # thousandths
    commander = open_cia402(ask())
    commander.move_to(PLAN[0])
    commander.close()


def test_a_speed_that_a_drive_cannot_be_told_is_refused(start_drive: Callable, ask: Ask):
    for node in (1, 2):
        start_drive(node)
    error = refused(ask(speed=0.9 * RPM_BEHIND_GEAR))
    assert isinstance(error, ConfigError)
    assert "hip" in str(error)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"knee": ""}, "joints that have no CANopen drive: knee"),
        ({"options": {"velocity_units": "rpm"}}, "did you mean 'velocity_unit'"),
        ({"options": {"joints": {"kne": {}}}}, "did you mean 'knee'"),
        ({"interface": "slcan"}, "slcan can be opened only once"),
    ],
)
def test_what_cannot_work_is_refused_before_a_bus_is_opened(
    ask: Ask, changes: dict[str, object], said: str
):
    assert said in str(refused(ask(**changes)))


def test_a_drive_that_does_not_answer_is_named(start_drive: Callable, ask: Ask):
    start_drive(1)
    error = refused(ask())
    assert isinstance(error, HardwareError)
    assert "knee (node 2)" in str(error)


def test_a_joint_that_never_moves_needs_no_drive(start_drive: Callable, ask: Ask):
    start_drive(1)
    plan = (PlannedPose(1, np.array([0.2, 0.0])), PlannedPose(2, np.array([0.1, 0.0])))
    open_cia402(ask(knee="", plan=plan)).close()
