# SPDX-License-Identifier: Apache-2.0
"""Recording with a fake robot. Not covered here: engines, processes that are killed."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from comcal.errors import ConfigError, HardwareError, NotStillError
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import approaches, cut
from comcal.measure.poses_csv import read_poses
from comcal.measure.progress import Event, PoseFinished, PoseRetried, PoseSkipped
from comcal.measure.raw import raw_path
from comcal.measure.recorder import record
from comcal.measure.session import Session, create_session
from comcal.robot.model import Robot

Plan = tuple[PlannedPose, ...]
Make = Callable[..., Any]


@pytest.fixture
def session(robot: Robot, tmp_path: Path) -> Session:
    return create_session(tmp_path / "s", robot, source="fake", seed=0)


def rows_of(session: Session) -> list[dict[str, str]]:
    with session.poses_csv.open(newline="") as file:
        return list(csv.DictReader(file))


def test_every_planned_pose_gets_a_row_with_raw_samples(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    events: list[Event] = []
    summary = record(robot, fake, fake, plan, session, on_event=events.append)
    assert summary.recorded == tuple(p.pose for p in plan)
    assert summary.skipped == ()
    assert [e.pose for e in events if isinstance(e, PoseFinished)] == list(summary.recorded)
    for pose, row in zip(plan, rows_of(session), strict=True):
        assert int(row["pose"]) == pose.pose
        assert row["configuration"] == pose.configuration
        q = [float(row[f"q.{joint}"]) for joint in robot.tree.joint_names]
        np.testing.assert_allclose(q, pose.q, atol=1e-12)
        assert 0.3 * 0.1 < float(row["se.ft.l_foot.fz"]) < 3 * 0.1
        assert 0.3 * 0.5 < float(row["sd.ft.l_foot.fz"]) < 3 * 0.5
        assert abs(float(row["ft.l_foot.fz"]) - 18.6 * 9.81 / 2) < 0.6
        with raw_path(session.directory, pose.pose).open("rb") as file:
            times = [m.log_time for _, _, m in make_reader(file).iter_messages(["/ft/l_foot"])]
        assert len(times) >= 125
        assert times[0] < 1e9 * float(row["t"]) < times[-1]


def test_the_reader_takes_what_the_recorder_writes(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    record(robot, fake, fake, plan, session)
    table = read_poses(session.poses_csv, robot, session.tares())
    assert table.pose == tuple(p.pose for p in plan)
    assert not [note for note in table.notes if "unknown" in note or "ignored" in note]
    np.testing.assert_allclose(table.q, [p.q for p in plan], atol=1e-12)


@pytest.mark.parametrize("finished", [1, 2, 4])
def test_an_interrupted_recording_continues_to_the_same_bytes(
    make_fake: Make, robot: Robot, plan: Plan, tmp_path: Path, finished: int
) -> None:
    whole = create_session(tmp_path / "whole", robot, source="fake", seed=0)
    record(robot, fake := make_fake(), fake, plan, whole)

    parts = create_session(tmp_path / "parts", robot, source="fake", seed=0)
    fake = make_fake()

    def interrupt() -> None:
        if len(fake.moves) > finished:
            raise KeyboardInterrupt

    fake.on_read = interrupt
    with pytest.raises(KeyboardInterrupt):
        record(robot, fake, fake, plan, parts)
    assert parts.finished_poses() == tuple(p.pose for p in plan[:finished])

    summary = record(robot, fake := make_fake(), fake, plan, parts)
    assert summary.before == tuple(p.pose for p in plan[:finished])
    assert parts.poses_csv.read_bytes() == whole.poses_csv.read_bytes()
    # The pose before is visited again: every joint comes from the same side as in one go.
    assert fake.moves[:2] == [plan[finished - 1].pose, plan[finished].pose]
    assert len(list((parts.directory / "raw").glob("*.partial-1"))) == 1


def test_a_finished_session_is_left_as_it_is(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    record(robot, fake, fake, plan, session)
    before = session.poses_csv.read_bytes()
    fake.moves.clear()
    summary = record(robot, fake, fake, plan, session)
    assert summary.recorded == ()
    assert fake.moves == []
    assert session.poses_csv.read_bytes() == before


def test_a_pose_that_never_becomes_still_is_tried_twice_and_named(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    fake.unstill = {plan[2].pose}
    events: list[Event] = []
    summary = record(robot, fake, fake, plan, session, on_event=events.append)
    assert fake.moves.count(plan[2].pose) == 2
    assert [e.pose for e in events if isinstance(e, PoseRetried)] == [plan[2].pose]
    (skipped,) = summary.skipped
    assert isinstance(skipped, PoseSkipped)
    assert "CoP x" in skipped.reason
    assert "limit 1 mm" in skipped.reason
    assert plan[2].pose not in session.finished_poses()
    fake.unstill = set()
    again = record(robot, fake, fake, plan, session)
    assert again.recorded == (plan[2].pose,)
    assert set(session.finished_poses()) == {p.pose for p in plan}


def test_no_still_pose_at_all_is_an_error(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    fake.unstill = {p.pose for p in plan}
    with pytest.raises(NotStillError, match="CoP x"):
        record(robot, fake, fake, plan, session)
    assert not session.poses_csv.exists()


def test_a_robot_that_stands_still_elsewhere_has_not_arrived(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    fake.absent = {plan[0].pose}
    (skipped,) = record(robot, fake, fake, plan, session).skipped
    assert "is not where the plan wants it" in skipped.reason
    assert "0.5 rad" in skipped.reason


def test_waiting_ends_at_the_timeout_of_the_source_clock(
    make_fake: Make, robot: Robot, plan: Plan, session: Session
) -> None:
    fake = make_fake()
    start = 60.0 * plan[0].pose
    fake.sway = lambda t: np.where(t - start < 3.0, 0.01 * np.sin(20 * t), 0.0)
    record(robot, fake, fake, plan[:1], session)
    (row,) = rows_of(session)
    assert 3.0 < float(row["t"]) - start < 4.5  # still for a second, then the window


def test_approach_is_the_side_from_which_each_joint_came(robot: Robot, plan: Plan) -> None:
    joints = robot.tree.joint_names
    here = replace(plan[0], q=np.zeros(len(joints)), approach={})
    q = np.zeros(len(joints))
    q[0], q[1] = 0.3, -0.3
    there = replace(here, q=q, approach={joints[2]: -1})
    found = approaches(there, here, joints)
    assert list(found.values()) == [1, -1, -1, *[0] * (len(joints) - 3)]
    assert approaches(here, there, joints)[joints[0]] == -1
    assert set(approaches(here, None, joints).values()) == {None}


def test_a_repeated_pose_gets_a_new_row_and_the_old_one_stays(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    record(robot, fake, fake, plan, session)
    before = session.poses_csv.read_bytes()
    session.plan_repetition(plan[1].pose, as_pose=100)
    fake.moves.clear()
    summary = record(robot, fake, fake, plan, session)
    assert summary.recorded == (100,)
    assert fake.moves == [plan[0].pose, 100]
    assert session.poses_csv.read_bytes().startswith(before)
    assert session.superseded() == (plan[1].pose,)
    old, new = rows_of(session)[1], rows_of(session)[-1]
    for column in ("configuration", "tilt", "support", "approach.l_knee"):
        assert old[column] == new[column]
    assert raw_path(session.directory, plan[1].pose).exists()
    assert raw_path(session.directory, 100).exists()
    session.plan_repetition(100, as_pose=101)
    record(robot, fake, fake, plan, session)
    assert session.superseded() == (plan[1].pose, 100)


def test_a_plan_whose_numbers_mean_other_poses_is_refused(
    robot: Robot, fake: Any, plan: Plan, session: Session
) -> None:
    record(robot, fake, fake, plan[:2], session)
    other = (plan[0], replace(plan[1], q=plan[1].q + 0.2), plan[2])
    with pytest.raises(ConfigError, match=f"pose {plan[1].pose} of the plan is not"):
        record(robot, fake, fake, other, session)
    longer = record(robot, fake, fake, plan, session)
    assert longer.recorded == tuple(p.pose for p in plan[2:])


def test_slopes_appear_only_in_tables_of_plans_that_have_them(
    robot: Robot, fake: Any, plan: Plan, session: Session, tmp_path: Path
) -> None:
    record(robot, fake, fake, plan, session)
    assert "floor.pitch" not in rows_of(session)[0]
    tilted = (plan[0], replace(plan[1], floor_pitch=0.1))
    other = create_session(tmp_path / "tilted", robot)
    record(robot, fake, fake, tilted, other)
    assert [row["floor.pitch"] for row in rows_of(other)] == ["0.0", "0.1"]


def test_a_dead_source_is_a_hardware_error(
    robot: Robot, fake: Any, plan: Plan, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = fake.read
    monkeypatch.setattr(fake, "read", lambda duration: cut(read(duration), slice(0, 0)))
    with pytest.raises(HardwareError, match=r"fake 1\.0"):
        record(robot, fake, fake, plan, session)


@pytest.mark.parametrize("rate", [10.0, 60.0, 1000.0])
def test_slow_and_fast_sensors_give_at_least_25_samples(
    make_fake: Make, robot: Robot, plan: Plan, session: Session, rate: float
) -> None:
    events: list[Event] = []
    fake = make_fake(rate=rate)
    record(robot, fake, fake, plan[:2], session, on_event=events.append)
    finished = [e for e in events if isinstance(e, PoseFinished)]
    assert [e.samples for e in finished] == [max(25, round(0.2 * rate))] * 2
