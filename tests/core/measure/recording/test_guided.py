# SPDX-License-Identifier: Apache-2.0
"""Recording a robot that a person moves. Commanded robots are in test_guard.py."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from comcal.errors import HardwareError
from comcal.measure.guided import RAW_KEPT, Guidance
from comcal.measure.operator import Person, Wish
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import cut
from comcal.measure.progress import (
    Event,
    OnEvent,
    PoseFinished,
    PoseObserved,
    PoseRepeated,
    RecordingSummary,
    ignore,
)
from comcal.measure.raw import raw_path
from comcal.measure.recorder import record
from comcal.measure.session import Session, create_session
from comcal.measure.still import StillCriterion
from comcal.robot.model import Robot

Plan = tuple[PlannedPose, ...]
PATIENT = StillCriterion(timeout=math.inf)


@pytest.fixture
def session(robot: Robot, tmp_path: Path) -> Session:
    return create_session(tmp_path / "s", robot, source="hand")


@pytest.fixture
def three(robot: Robot, plan: Plan) -> Plan:
    """Three poses, 0.3 rad apart in all joints, the second one back."""
    q = np.zeros(len(robot.tree.joint_names))
    return tuple(replace(plan[i], q=q + step) for i, step in enumerate((0.0, 0.3, 0.1)))


def guided(
    robot: Robot,
    hand: Any,
    plan: Plan,
    session: Session,
    operator: Any,
    on_event: OnEvent = ignore,
    criterion: StillCriterion = PATIENT,
    vias: dict[int, PlannedPose] | None = None,
) -> RecordingSummary:
    guidance = Guidance(operator, vias or {})
    return record(robot, hand, Person(), plan, session, criterion, on_event, guidance)


def follows(hand: Any, plan: Plan, events: list[Event]) -> OnEvent:
    """Move the robot to whatever is wanted, like a patient person."""

    def on_event(event: Event) -> None:
        events.append(event)
        if isinstance(event, PoseObserved):
            hand.goal = event.observation.pose.q

    return on_event


def rows_of(session: Session) -> list[dict[str, str]]:
    with session.poses_csv.open(newline="") as file:
        return list(csv.DictReader(file))


def test_poses_are_accepted_by_themselves_one_after_the_other(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    events: list[Event] = []
    summary = guided(robot, hand, three, session, operator, follows(hand, three, events))
    assert summary.recorded == (0, 1, 2)
    assert hand.poses == [0, 1, 2]
    for pose, row in zip(three, rows_of(session), strict=True):
        q = [float(row[f"q.{joint}"]) for joint in robot.tree.joint_names]
        np.testing.assert_allclose(q, pose.q, atol=1e-6)
    assert operator.stop is None  # nothing to stop where a person moves the robot


def test_who_passes_through_the_pose_is_not_accepted(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    hand.q = three[0].q - 2.0
    hand.goal = three[0].q + 2.0  # slowly past the wanted pose
    hand.speed = 0.04  # 1.25 s within the limit of arrival on either side
    distances: list[float] = []

    def on_event(event: Event) -> None:
        assert not isinstance(event, PoseFinished), "accepted in passing"
        distances.append(float(np.abs(hand.q - three[0].q).max()))
        if distances[-1] > 0.5 and hand.q[0] > three[0].q[0]:
            operator.wishes.append(Wish.QUIT)

    with pytest.raises(KeyboardInterrupt):
        guided(robot, hand, three, session, operator, on_event)
    assert min(distances) < PATIENT.arrival
    assert session.finished_poses() == ()


def test_a_person_may_take_any_time(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    def after_minutes() -> None:
        if hand.t > 60.0:
            hand.goal = three[0].q

    hand.on_read = after_minutes
    summary = guided(robot, hand, three[:1], session, operator)
    assert summary.recorded == (0,)
    (row,) = rows_of(session)
    assert float(row["t"]) > 60.0
    with raw_path(session.directory, 0).open("rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages(["/ft/l_foot"])]
    assert 1e-9 * (times[-1] - times[0]) <= RAW_KEPT + 0.2  # minutes of waiting are not kept
    assert times[0] < 1e9 * float(row["t"]) < times[-1]


def test_a_typed_time_out_leaves_the_pose_out(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    hand.goal = three[1].q
    criterion = StillCriterion(timeout=3.0)
    summary = guided(robot, hand, three[:2], session, operator, criterion=criterion)
    assert summary.recorded == (1,)
    (skipped,) = summary.skipped
    assert skipped.pose == 0
    assert "is not where the plan wants it" in skipped.reason


def test_skip_goes_on_and_the_same_command_asks_again(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    operator.wishes = [Wish.SKIP]
    summary = guided(robot, hand, three, session, operator, follows(hand, three, []))
    assert summary.recorded == (1, 2)
    assert [(s.pose, s.by_operator) for s in summary.skipped] == [(0, True)]
    again = guided(robot, hand, three, session, operator, follows(hand, three, []))
    assert again.recorded == (0,)


def test_leaving_out_everything_is_no_error(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    operator.wishes = [Wish.SKIP] * 3
    assert guided(robot, hand, three, session, operator).recorded == ()


def test_redo_measures_the_last_pose_again_and_goes_on(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    events: list[Event] = []
    follow = follows(hand, three, events)
    redone: list[bool] = []

    def on_event(event: Event) -> None:
        follow(event)
        if isinstance(event, PoseFinished) and event.pose == 1 and not redone:
            redone.append(True)
            operator.wishes.append(Wish.REDO)

    summary = guided(robot, hand, three, session, operator, on_event)
    assert summary.recorded == (0, 1, 3, 2)
    assert [e for e in events if isinstance(e, PoseRepeated)] == [PoseRepeated(1, 3)]
    assert session.superseded() == (1,)
    again, old = rows_of(session)[2], rows_of(session)[1]
    joint = f"q.{robot.tree.joint_names[0]}"
    assert abs(float(again[joint]) - float(old[joint])) < 1e-3


def test_redo_before_the_first_pose_changes_nothing(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    operator.wishes = [Wish.REDO]
    summary = guided(robot, hand, three, session, operator, follows(hand, three, []))
    assert summary.recorded == (0, 1, 2)
    assert session.repetitions() == {}


def test_quitting_saves_and_the_same_command_goes_on(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    follow = follows(hand, three, [])

    def on_event(event: Event) -> None:
        follow(event)
        if isinstance(event, PoseFinished) and event.pose == 1:
            operator.wishes.append(Wish.QUIT)

    with pytest.raises(KeyboardInterrupt):
        guided(robot, hand, three, session, operator, on_event)
    assert session.finished_poses() == (0, 1)
    summary = guided(robot, hand, three, session, operator, follows(hand, three, []))
    assert (summary.before, summary.recorded) == ((0, 1), (2,))


def test_the_pose_before_is_not_taken_for_one_close_to_it(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    near = replace(three[1], q=three[0].q + 0.04)  # within the limit of arrival
    hand.goal = three[0].q
    reasons: list[str] = []

    def on_event(event: Event) -> None:
        if isinstance(event, PoseObserved) and event.observation.pose.pose == 1:
            reasons.append(event.observation.reason)
            if len(reasons) == 20:
                hand.goal = near.q

    summary = guided(robot, hand, (three[0], near), session, operator, on_event)
    assert summary.recorded == (0, 1)
    assert sum("still stands in the pose before" in reason for reason in reasons) >= 10
    first, second = rows_of(session)
    joint = f"q.{robot.tree.joint_names[0]}"
    assert float(second[joint]) - float(first[joint]) > 0.03


def test_the_side_from_which_a_joint_came_is_seen_on_its_encoder(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    still = replace(three[2], pose=3)
    guided(robot, hand, (*three, still), session, operator, follows(hand, three, []))
    name = f"approach.{robot.tree.joint_names[0]}"
    assert [row[name] for row in rows_of(session)] == ["1", "1", "-1", "0"]


def test_nothing_is_said_of_joints_that_were_not_seen_to_move(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    hand.q = hand.goal = three[0].q
    guided(robot, hand, three[:1], session, operator)
    (row,) = rows_of(session)
    assert {row[f"approach.{joint}"] for joint in robot.tree.joint_names} == {""}


def test_who_overshoots_and_comes_back_came_from_the_other_side(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    hand.goal = three[0].q + 0.03

    def come_back() -> None:
        if np.abs(hand.q - hand.goal).max() == 0.0:
            hand.goal = three[0].q

    hand.on_read = come_back
    guided(robot, hand, three[:1], session, operator)
    (row,) = rows_of(session)
    assert row[f"approach.{robot.tree.joint_names[0]}"] == "-1"


def test_a_pose_with_a_via_is_only_accepted_from_beyond(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    joints = robot.tree.joint_names
    pose = replace(three[0], approach=dict.fromkeys(joints, -1))
    via = replace(pose, q=pose.q + 0.052)
    hand.goal = pose.q  # from below: the wrong side
    seen: list[tuple[bool, str]] = []

    def on_event(event: Event) -> None:
        if not isinstance(event, PoseObserved):
            return
        seen.append((event.observation.is_via, event.observation.reason))
        if len(seen) == 30:
            hand.goal = via.q
        if not event.observation.is_via:
            hand.goal = pose.q

    guided(robot, hand, (pose,), session, operator, on_event, vias={0: via})
    assert all(is_via for is_via, _ in seen[:30])
    assert "first has to go beyond" in seen[29][1]
    (row,) = rows_of(session)
    assert {row[f"approach.{joint}"] for joint in joints} == {"-1"}


def test_coming_from_the_wrong_side_after_all_is_told(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    joints = robot.tree.joint_names
    pose = replace(three[0], approach=dict.fromkeys(joints, -1))
    via = replace(pose, q=pose.q + 0.052)
    reasons: list[str] = []
    places = iter([via.q, pose.q - 0.04, pose.q])  # past it, and back from below

    def on_event(event: Event) -> None:
        if isinstance(event, PoseObserved):
            reasons.append(event.observation.reason)
            if np.abs(hand.q - hand.goal).max() < 1e-9:
                hand.goal = next(places, hand.goal)
            if "is to arrive decreasing" in event.observation.reason:
                operator.wishes.append(Wish.SKIP)

    hand.q = hand.goal = pose.q - 0.1
    summary = guided(robot, hand, (pose,), session, operator, on_event, vias={0: via})
    assert [s.by_operator for s in summary.skipped] == [True]
    assert "is to arrive decreasing" in reasons[-1]


def test_what_the_source_counts_stands_beside_the_poses(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    follow = follows(hand, three, [])

    def on_event(event: Event) -> None:
        follow(event)
        if isinstance(event, PoseFinished):
            hand.lost += 2

    summary = guided(robot, hand, three, session, operator, on_event)
    assert summary.status is not None
    assert summary.status.lost == {"l_foot": 6}
    with (session.directory / "counts.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [(line["pose"], line["lost.l_foot"]) for line in lines] == [
        ("0", "0"),
        ("1", "2"),
        ("2", "4"),
    ]


def test_what_is_seen_names_the_farthest_joint_the_load_and_the_warmth(
    robot: Robot, hand: Any, three: Plan, session: Session, operator: Any
) -> None:
    events: list[Event] = []
    guided(robot, hand, three[:1], session, operator, follows(hand, three, events))
    seen = [e.observation for e in events if isinstance(e, PoseObserved)]
    assert abs(seen[0].joints[0].way) > 0.1
    assert seen[-1].joints[0].way == pytest.approx(0.0, abs=1e-6)
    assert seen[-1].reason == ""
    assert seen[-1].force == pytest.approx(18.6 * 9.81, rel=0.01)
    assert seen[-1].weight == pytest.approx((18.6 - 0.2) * 9.81)  # the soles are below the cuts
    assert seen[-1].footprint is not None
    assert seen[-1].footprint.margin > 0.0
    now, change = seen[-1].temperatures["l_foot"]
    assert now == pytest.approx(30.0 + 0.01 * hand.t, abs=0.01)
    assert change == pytest.approx(0.01 * hand.t, abs=0.005)
    assert seen[-1].motions[0].excess < 1.0


def test_a_source_that_falls_silent_ends_the_recording(
    robot: Robot,
    hand: Any,
    three: Plan,
    session: Session,
    operator: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read: Callable[[float], Any] = hand.read
    monkeypatch.setattr(
        hand, "read", lambda d: read(d) if hand.t < 2.0 else cut(read(d), slice(0, 0))
    )
    with pytest.raises(HardwareError, match=r"hand-moved 1\.0"):
        guided(robot, hand, three, session, operator)
