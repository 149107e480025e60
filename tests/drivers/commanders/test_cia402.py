# SPDX-License-Identifier: Apache-2.0
"""The profile position commander against drives that lag, fail, ignore and run away."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

import can
import numpy as np
import pytest

from comcal.errors import HardwareError, UsageError
from comcal.measure.plan import PlannedPose
from comcal_drivers.canopen_setup.sdo import Drive, open_network
from comcal_drivers.commanders.axis import Axis, Patience
from comcal_drivers.commanders.cia402 import ProfilePositionCommander
from comcal_drivers.commanders.profile import JointUnits

COUNTS_PER_TURN = 40_000.0
UNIT = math.tau / COUNTS_PER_TURN  # one count per second at the joint
SPEED, ACCELERATION = 1.0, 50.0
PATIENCE = Patience(state=0.5, acknowledge=0.3)
PLAN = tuple(
    PlannedPose(k, np.array(q))
    for k, q in enumerate([(0.0, 0.0), (0.1, -0.05), (-0.1, 0.1), (0.8, -0.4)])
)

Open = Callable[..., ProfilePositionCommander]


@pytest.fixture
def open_commander(channel: str, opened: ExitStack) -> Open:
    """A commander of joints a and b, behind nodes 1 and 2."""

    def make(nodes: int = 2, *, lower: float = -1.0):
        bus = opened.enter_context(can.Bus(interface="virtual", channel=channel))
        network = opened.enter_context(open_network(bus, [1, 2]))
        units = [
            JointUnits(name, COUNTS_PER_TURN, 1.0, sign, 0.0, UNIT)
            for name, sign in (("a", 1), ("b", -1))
        ]
        axes = [
            Axis(Drive(network, k + 1, units[k].joint, 0.25), units[k], k, lower, 1.0, PATIENCE)
            for k in range(nodes)
        ]
        commander = ProfilePositionCommander(axes, PLAN, SPEED, ACCELERATION)
        opened.callback(commander.close)
        return commander

    return make


def wait_until(condition: Callable[[], object], seconds: float = 3.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "nothing happened in time"
        time.sleep(0.005)


def test_joints_go_to_the_planned_pose_and_arrive_together(
    start_drive: Callable, open_commander: Open
):
    a, b = start_drive(1), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[1])
    wait_until(lambda: not commander.is_moving)
    assert commander.failure is None
    assert [round(d.counts) for d in (a, b)] == [
        round(0.1 / UNIT),
        round(0.05 / UNIT),  # joint b turns the other way round
    ]
    assert a.number(0x6081) == pytest.approx(SPEED / UNIT, abs=1)
    assert b.number(0x6083) == pytest.approx(0.5 * ACCELERATION / UNIT, rel=3e-3)
    assert a.counts / a.velocity == pytest.approx(b.counts / b.velocity, rel=1e-3)


def test_poses_follow_each_other_also_while_still_moving(
    start_drive: Callable, open_commander: Open
):
    a, b = start_drive(1), start_drive(2)
    commander = open_commander()
    for pose in (PLAN[1], PLAN[2], PLAN[0]):
        commander.move_to(pose)
    wait_until(lambda: not commander.is_moving)
    assert (round(a.counts), round(b.counts)) == (0, 0)
    assert commander.failure is None


def test_drives_that_take_their_time_are_waited_for(start_drive: Callable, open_commander: Open):
    a = start_drive(1, state_delay=0.1)
    open_commander(1).move_to(PLAN[1])
    assert a.state == "enabled"


def test_a_drive_without_a_deceleration_of_its_own_moves(
    start_drive: Callable, open_commander: Open
):
    a = start_drive(1, leave_out=(0x6084,))
    open_commander(1).move_to(PLAN[1])
    assert a.is_moving


def test_a_fault_from_before_is_reset_once(start_drive: Callable, open_commander: Open):
    a = start_drive(1, state="fault", error_code=0x3220)
    commander = open_commander(1)
    commander.move_to(PLAN[1])
    assert a.words[:2] == [0x00, 0x80]
    wait_until(lambda: not commander.is_moving)
    assert commander.failure is None


def test_a_fault_that_stays_is_told_with_its_code(start_drive: Callable, open_commander: Open):
    start_drive(1, state="fault", error_code=0x3220, never_resets=True)
    with pytest.raises(HardwareError, match=r"a \(node 1\).*Fault, error code 0x3220"):
        open_commander(1).move_to(PLAN[1])


@pytest.mark.parametrize(
    ("behaviour", "said"),
    [
        ({"stuck_in": "disabled"}, "stays in Switch On Disabled after control word 0x0006"),
        ({"stuck_in": "on"}, "stays in Switched On after control word 0x000F"),
        ({"fault_in": "enabled"}, "Fault, error code 0x3220"),
        ({"ignores_set_points": True}, "does not take the set-point"),
        ({"keeps_target": 12}, "did not keep what was written to 0x607A"),
    ],
)
def test_a_drive_that_does_not_obey_stops_the_others(
    start_drive: Callable, open_commander: Open, behaviour: dict, said: str
):
    a, b = start_drive(1), start_drive(2, **behaviour)
    with pytest.raises(HardwareError, match=said):
        open_commander().move_to(PLAN[3])
    assert not a.is_moving
    assert not b.is_moving
    assert a.state == "quick stop"
    assert round(a.counts) < 0.8 / UNIT


def test_a_drive_that_is_not_there_is_an_error_before_anything_gets_power(
    start_drive: Callable, open_commander: Open
):
    a = start_drive(1)
    with pytest.raises(HardwareError, match=r"b \(node 2\)"):
        open_commander().move_to(PLAN[1])
    assert a.words == []


@pytest.mark.parametrize(
    ("behaviour", "said"),
    [
        ({"fault_during_motion": 0.1}, "Fault, error code 0x8611"),
        ({"following_error_during_motion": 0.1}, "following error"),
        ({"speed_factor": 5.0}, "faster than it was told"),
    ],
)
def test_a_failure_on_the_way_stops_all_joints_and_is_told_next(
    start_drive: Callable, open_commander: Open, behaviour: dict, said: str
):
    a, b = start_drive(1), start_drive(2, **behaviour)
    commander = open_commander()
    commander.move_to(PLAN[3])
    wait_until(lambda: commander.failure is not None)
    wait_until(lambda: a.state == "quick stop" and not b.is_moving)
    assert abs(a.counts) < 0.7 / UNIT
    with pytest.raises(HardwareError, match=said):
        commander.move_to(PLAN[1])


def test_a_drive_that_falls_silent_on_the_way_stops_the_others(
    start_drive: Callable, open_commander: Open
):
    a, b = start_drive(1), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[3])
    b.local.remove_network()
    wait_until(lambda: commander.failure is not None)
    wait_until(lambda: a.state == "quick stop")
    assert "does not answer" in str(commander.failure)
    with pytest.raises(HardwareError, match=r"b \(node 2\)"):
        commander.close()


def test_an_emergency_message_stops_all_joints(start_drive: Callable, open_commander: Open):
    a, b = start_drive(1), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[3])
    b.local.emcy.send(0x4310)
    wait_until(lambda: a.state == "quick stop" and b.state == "quick stop")
    assert "0x4310" in str(commander.failure)


def test_a_blocked_joint_is_noticed_when_its_time_is_over(
    start_drive: Callable, open_commander: Open, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("comcal_drivers.commanders.cia402.ARRIVAL_SLACK", 0.1)
    start_drive(1, blocked=True)
    commander = open_commander(1)
    commander.move_to(PLAN[1])
    wait_until(lambda: commander.failure is not None)
    assert "has not arrived in time" in str(commander.failure)
    assert "joint a" in str(commander.failure)


def test_the_abort_key_stops_all_joints_at_once(start_drive: Callable, open_commander: Open):
    a, b = start_drive(1), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[3])
    time.sleep(0.1)
    began = time.monotonic()
    commander.stop()
    assert max(a.stopped_at[0], b.stopped_at[0]) - began < 0.4
    assert (a.state, b.state) == ("quick stop", "quick stop")
    here = a.counts
    assert 0 < here < 0.8 / UNIT
    time.sleep(0.05)
    assert a.counts == here
    commander.stop()
    assert commander.failure is None


def test_after_a_stop_the_robot_may_move_again_and_nothing_old_is_left_to_do(
    start_drive: Callable, open_commander: Open
):
    a, _ = start_drive(1), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[3])
    commander.stop()
    commander.move_to(PLAN[1])
    wait_until(lambda: not commander.is_moving)
    assert round(a.counts) == round(0.1 / UNIT)
    assert commander.failure is None


@pytest.mark.parametrize("delay", [0.0, 0.005, 0.01, 0.02, 0.04, 0.08])
def test_a_stop_during_move_to_leaves_nothing_running(
    start_drive: Callable, open_commander: Open, delay: float
):
    a, b = start_drive(1, state_delay=0.01), start_drive(2, state_delay=0.01)
    commander = open_commander()
    stopper = threading.Timer(delay, commander.stop)
    stopper.start()
    told = ""
    try:
        commander.move_to(PLAN[3])
    except HardwareError as error:
        told = str(error)
    stopper.join()
    assert not told or "stopped" in told
    if commander.is_moving:  # the stop came before there was anything to stop
        commander.stop()
    for _ in range(2):
        assert not a.is_moving
        assert not b.is_moving
        time.sleep(0.03)


def test_a_drive_that_is_deaf_to_the_quick_stop_is_named_and_the_others_stop(
    start_drive: Callable, open_commander: Open
):
    a, b = start_drive(1, deaf_to_quick_stop=True), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[3])
    with pytest.raises(HardwareError, match=r"a \(node 1\).*quick stop.*emergency stop"):
        commander.stop()
    assert b.state == "quick stop"
    a.deaf_to_quick_stop = False


def test_stopping_before_the_first_motion_touches_no_drive(
    start_drive: Callable, open_commander: Open
):
    a = start_drive(1, state="enabled")
    commander = open_commander(1)
    commander.stop()
    commander.close()
    commander.close()
    assert a.words == []
    with pytest.raises(HardwareError, match="closed"):
        commander.move_to(PLAN[1])


def test_only_planned_poses_within_the_limits_are_commanded(
    start_drive: Callable, open_commander: Open
):
    a, _ = start_drive(1), start_drive(2)
    commander = open_commander(lower=-0.2)
    with pytest.raises(UsageError, match="not in the plan"):
        commander.move_to(PlannedPose(1, np.array([0.1, -0.04])))
    with pytest.raises(UsageError, match=r"joint b would leave its limits.*pose 3|pose 3.*joint b"):
        commander.move_to(PLAN[3])
    assert a.words == []


def test_a_drive_that_says_it_is_outside_of_the_limits_gets_no_power(
    start_drive: Callable, open_commander: Open
):
    a, b = start_drive(1), start_drive(2)
    b.counts = 2.0 / UNIT
    with pytest.raises(HardwareError, match=r"b \(node 2\).*home the drive"):
        open_commander().move_to(PLAN[1])
    assert a.words == b.words == []


def test_nothing_is_left_to_run_to_when_the_power_comes_on(
    start_drive: Callable, open_commander: Open
):
    a = start_drive(1)
    a.counts = 100.0
    a.local.set_data(0x607A, 0, (5000).to_bytes(4, "little"))
    seen: list[int] = []
    a.local.add_write_callback(
        lambda index, data, **_: seen.append(a.number(0x607A)) if index == 0x6040 else None
    )
    open_commander(1).move_to(PLAN[1])
    assert seen[0] == 100


def test_closing_leaves_the_drives_holding(start_drive: Callable, open_commander: Open):
    a, _ = start_drive(1), start_drive(2)
    commander = open_commander()
    commander.move_to(PLAN[1])
    commander.close()
    assert a.state == "quick stop"
    assert not a.is_moving
