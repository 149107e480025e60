# SPDX-License-Identifier: Apache-2.0
"""What stands between a recording and a robot that a program moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.errors import HardwareError, UsageError
from comcal.measure.guard import GuardedCommander
from comcal.measure.guided import Guidance
from comcal.measure.operator import Wish
from comcal.measure.plan import PlannedPose
from comcal.measure.progress import Event, PoseFinished
from comcal.measure.recorder import record
from comcal.measure.session import Session, create_session
from comcal.measure.source import Block
from comcal.robot.model import Robot

Plan = tuple[PlannedPose, ...]


class Motor:
    """Moves the robot that a HandMoved source measures."""

    def __init__(self, hand: Any) -> None:
        self.hand = hand
        self.asked: list[np.ndarray] = []
        self.stops = 0
        self.is_closed = False

    def move_to(self, pose: PlannedPose) -> None:
        self.asked.append(pose.q)
        self.hand.goal = pose.q

    def stop(self) -> None:
        self.stops += 1
        self.hand.goal = self.hand.q.copy()

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def motor(hand: Any) -> Motor:
    hand.speed = 0.1
    return Motor(hand)


@pytest.fixture
def session(robot: Robot, tmp_path: Path) -> Session:
    return create_session(tmp_path / "s", robot, source="hand")


@pytest.fixture
def two(robot: Robot, plan: Plan) -> Plan:
    q = np.zeros(len(robot.tree.joint_names))
    return (replace(plan[0], q=q), replace(plan[1], q=q + 0.1))


def guard(robot: Robot, motor: Motor, plan: Plan, *, agrees: bool = True) -> GuardedCommander:
    return GuardedCommander(motor, robot, plan, 0.1, lambda _: agrees)


def test_a_guarded_robot_is_driven_through_the_plan(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    commander = guard(robot, motor, two)
    summary = record(robot, hand, commander, two, session, guidance=Guidance(operator))
    assert summary.recorded == (0, 1)
    assert [q.tolist() for q in motor.asked] == [pose.q.tolist() for pose in two]
    assert motor.stops == 0


def test_the_way_is_given_the_time_that_its_length_needs(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    far = (replace(two[0], q=two[0].q + 0.8),)  # ten seconds; the default time-out is five
    summary = record(robot, hand, guard(robot, motor, far), far, session, guidance=Guidance())
    assert summary.recorded == (0,)


def test_a_via_is_commanded_before_its_pose(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    pose = replace(two[1], approach=dict.fromkeys(robot.tree.joint_names, -1))
    via = replace(pose, q=pose.q + 0.05)
    commander = guard(robot, motor, (pose, via))
    record(robot, hand, commander, (pose,), session, guidance=Guidance(operator, {1: via}))
    assert [q[0] for q in motor.asked] == [via.q[0], pose.q[0]]
    assert hand.q[0] == pytest.approx(pose.q[0])
    header, row = session.poses_csv.read_text().splitlines()
    approach = header.split(",").index(f"approach.{robot.tree.joint_names[0]}")
    assert row.split(",")[approach] == "-1"


def test_only_planned_poses_are_commanded(robot: Robot, motor: Motor, two: Plan) -> None:
    commander = guard(robot, motor, two)
    with pytest.raises(UsageError, match="not in the plan"):
        commander.move_to(replace(two[0], q=two[0].q + 1e-6))
    commander.move_to(replace(two[0], pose=77))  # a repetition has an id of its own
    assert len(motor.asked) == 1


@pytest.mark.parametrize("wrong", [10.0, np.nan])
def test_a_planned_pose_beyond_the_limits_is_refused_all_the_same(
    robot: Robot, motor: Motor, two: Plan, wrong: float
) -> None:
    q = two[0].q.copy()
    q[2] = wrong
    with pytest.raises(UsageError):
        guard(robot, motor, (replace(two[0], q=q),)).move_to(replace(two[0], q=q))
    assert motor.asked == []


def test_without_consent_nothing_moves_and_consent_is_asked_once(
    robot: Robot, motor: Motor, two: Plan
) -> None:
    with pytest.raises(UsageError, match="nobody agreed"):
        guard(robot, motor, two, agrees=False).move_to(two[0])
    assert motor.asked == []
    shown: list[str] = []

    def agree(text: str) -> bool:
        shown.append(text)
        return True

    commander = GuardedCommander(motor, robot, two, 0.1, agree)
    commander.move_to(two[0])
    commander.move_to(two[1])
    assert len(shown) == 1
    assert "2 planned poses" in shown[0]
    assert "0.1 rad/s" in shown[0]


def test_after_a_stop_nothing_moves_any_more(robot: Robot, motor: Motor, two: Plan) -> None:
    commander = guard(robot, motor, two)
    commander.stop()
    with pytest.raises(KeyboardInterrupt):
        commander.move_to(two[0])
    assert (motor.asked, motor.stops) == ([], 1)


def test_a_stop_while_a_motion_is_started_stops_that_motion(
    robot: Robot, motor: Motor, two: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    commander = guard(robot, motor, two)
    start = motor.move_to

    def slow_start(pose: PlannedPose) -> None:
        commander.stop()  # as another thread would in the midst of it
        start(pose)

    monkeypatch.setattr(motor, "move_to", slow_start)
    with pytest.raises(KeyboardInterrupt):
        commander.move_to(two[0])
    assert motor.stops == 2
    assert np.array_equal(motor.hand.goal, motor.hand.q)


def test_the_abort_key_stops_the_robot_and_saves(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    def on_event(event: Event) -> None:
        if isinstance(event, PoseFinished):

            def during_the_next_motion() -> None:
                if len(motor.asked) == 2 and hand.q[0] > 0.03 and not operator.wishes:
                    operator.wishes.append(Wish.QUIT)
                    operator.stop()

            hand.on_read = during_the_next_motion

    commander = guard(robot, motor, two)
    with pytest.raises(KeyboardInterrupt):
        record(robot, hand, commander, two, session, None, on_event, Guidance(operator))
    assert session.finished_poses() == (0,)
    assert motor.stops >= 1
    assert 0.03 <= hand.q[0] < 0.06  # where it was stopped, not where it was sent


def test_whatever_ends_a_recording_stops_the_robot(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    def vanish() -> None:
        if hand.t > 1.0:
            raise HardwareError("is gone", where="can0")

    hand.on_read = vanish
    with pytest.raises(HardwareError, match="is gone"):
        record(robot, hand, guard(robot, motor, two), two, session, guidance=Guidance(operator))
    assert motor.stops == 1


def test_a_joint_that_is_too_fast_is_stopped(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    hand.speed = 0.5  # five times what was agreed upon
    with pytest.raises(HardwareError, match="faster than allowed") as caught:
        record(robot, hand, guard(robot, motor, two), two, session, guidance=Guidance(operator))
    assert "0.5" in str(caught.value)
    assert motor.stops >= 1


def test_an_emulated_robot_may_be_in_its_pose_at_once(
    robot: Robot, hand: Any, motor: Motor, two: Plan, session: Session, operator: Any
) -> None:
    hand.speed = 1e3
    motor.is_emulated = True  # type: ignore[attr-defined]
    commander = guard(robot, motor, two)
    summary = record(robot, hand, commander, two, session, guidance=Guidance(operator))
    assert summary.recorded == (0, 1)


def test_the_agreed_speed_itself_is_fine(robot: Robot, motor: Motor, two: Plan) -> None:
    t = np.linspace(0.0, 0.2, 26)
    q = np.tile(0.1 * t[:, None], (1, len(robot.tree.joint_names)))
    commander = guard(robot, motor, two)
    commander.watch(Block(t, q, {}))
    commander.watch(Block(t[:1], q[:1] + 1.0, {}))  # a single sample has no speed
    commander.watch(Block(t, q * np.nan, {}))
    assert motor.stops == 0
