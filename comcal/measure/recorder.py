# SPDX-License-Identifier: Apache-2.0
"""Recording: drive the planned poses, wait until the robot stands still, average, write down.

A pose is finished when its row is on the disk; its raw samples are there before. Whatever stops the
recording loses at most the pose in progress. Resuming sends the robot to the pose before the next
one first, so that every joint is approached from the same side as in one go: with a simulated
source, which derives its noise from seed and pose, both give the same rows, bit by bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import ConfigError, HardwareError, NotStillError
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import approaches, cut, join, pose_row
from comcal.measure.progress import (
    OnEvent,
    PoseFinished,
    PoseRetried,
    PoseSkipped,
    PoseStarted,
    RecordingStarted,
    RecordingSummary,
    ignore,
)
from comcal.measure.raw import RawWriter, raw_path
from comcal.measure.session import Session
from comcal.measure.source import Block, Commander, Source
from comcal.measure.still import StillCriterion, judge_stillness
from comcal.robot.model import Robot

STEP = 0.2
"""Seconds that are read between two looks for a still window."""


@dataclass(frozen=True)
class _Task:
    """A pose to record; ``index`` is that of its row in the plan, whatever its id."""

    index: int
    pose: PlannedPose


@dataclass(frozen=True)
class _Waited:
    """The still window (None: there was none, for this reason) and how long it took [s]."""

    window: Block | None
    seconds: float = 0.0
    reason: str = ""


def record(
    robot: Robot,
    source: Source,
    commander: Commander,
    plan: Sequence[PlannedPose],
    session: Session,
    criterion: StillCriterion | None = None,
    on_event: OnEvent = ignore,
) -> RecordingSummary:
    """Record every pose of the plan that the session does not have yet.

    Parameters
    ----------
    robot : Robot
    source : Source
    commander : Commander
    plan : sequence of PlannedPose
    session : Session
        Poses noted there for repetition are measured again, under their new ids.
    criterion : StillCriterion or None
        None: the defaults.
    on_event : callable
        Called with what happens, as dataclasses of :mod:`comcal.measure.progress`.

    Returns
    -------
    RecordingSummary
        Names the poses that never became still: each was tried twice and then left out.

    Raises
    ------
    NotStillError
        If no pose of the session became still.
    ConfigError
        If a finished pose is another one than that of the same number in the plan.
    HardwareError
        If the source delivers nothing.
    UsageError
        If a pose cannot be commanded, or another recording runs in the same session.
    KeyboardInterrupt
        When interrupted; everything finished is saved.
    """
    return _Recorder(
        robot, source, commander, tuple(plan), session, criterion or StillCriterion(), on_event
    ).run()


@dataclass(frozen=True)
class _Recorder:
    robot: Robot
    source: Source
    commander: Commander
    plan: tuple[PlannedPose, ...]
    session: Session
    criterion: StillCriterion
    on_event: OnEvent

    def run(self) -> RecordingSummary:
        """Record; see :func:`record`."""
        with self.session.lock():
            before = self.session.finished_poses()
            self._check_finished()
            tasks = self._tasks(before)
            self.on_event(RecordingStarted(len(before) + len(tasks), len(before)))
            recorded: list[int] = []
            skipped: list[PoseSkipped] = []
            standing: int | None = None
            for task in tasks:
                if task.index > 0 and standing != task.index - 1:
                    self._wait(self.plan[task.index - 1], None)
                standing = task.index
                outcome = self._pose(task)
                if isinstance(outcome, PoseSkipped):
                    skipped.append(outcome)
                else:
                    recorded.append(task.pose.pose)
                self.on_event(outcome)
        if skipped and not recorded and not before:
            raise NotStillError(
                f"no pose became still, the first because of: {skipped[0].reason}",
                where=f"pose {skipped[0].pose}",
                next_step="wait longer (--timeout), hold the robot stiffer, or relax the "
                "criterion (--still-sd, --still-window, --arrival)",
            )
        return RecordingSummary(tuple(recorded), before, tuple(skipped))

    def _pose(self, task: _Task) -> PoseFinished | PoseSkipped:
        """Record one pose, trying twice."""
        pose = task.pose
        self.on_event(PoseStarted(pose.pose))
        waited = self._attempt(pose)
        if waited.window is None:
            self.on_event(PoseRetried(pose.pose, waited.reason))
            waited = self._attempt(pose)
        if waited.window is None:
            return PoseSkipped(pose.pose, waited.reason)
        previous = self.plan[task.index - 1] if task.index > 0 else None
        self.session.append_pose(
            pose_row(
                pose,
                waited.window,
                self.robot,
                approaches(pose, previous, self.robot.tree.joint_names),
                with_floor=any(p.floor_roll or p.floor_pitch for p in self.plan),
            )
        )
        return PoseFinished(pose.pose, waited.seconds, waited.window.t.size)

    def _attempt(self, pose: PlannedPose) -> _Waited:
        with RawWriter(raw_path(self.session.directory, pose.pose), self.robot) as raw:
            return self._wait(pose, raw)

    def _wait(self, pose: PlannedPose, raw: RawWriter | None) -> _Waited:
        """Move to *pose* and read until the robot stands still there, or for too long."""
        self.commander.move_to(pose)
        needed = max(self.criterion.settle, self.criterion.window)
        blocks = [self._read(needed, raw)]
        start = float(blocks[0].t[0])
        while True:
            block = join(blocks)
            judged = judge_stillness(block, self.robot, pose.support, self.criterion)
            reason = judged.reason
            if judged.window is not None:
                window = cut(block, judged.window)
                reason = self._distance(window, pose)
                if not reason:
                    return _Waited(window, float(window.t[-1]) - start)
            if float(block.t[-1]) - start >= self.criterion.timeout:
                return _Waited(None, reason=reason)
            blocks = [*self._recent(blocks), self._read(STEP, raw)]

    def _recent(self, blocks: Sequence[Block]) -> list[Block]:
        """Drop blocks that are too old to matter for a window yet to come."""
        c = self.criterion
        t = np.concatenate([block.t for block in blocks])
        longest = max(c.window, c.min_samples * float(np.median(np.diff(t))) if t.size > 1 else 0.0)
        oldest = float(t[-1]) - c.settle - longest
        return [block for block in blocks if float(block.t[-1]) > oldest]

    def _read(self, duration: float, raw: RawWriter | None) -> Block:
        block = self.source.read(duration)
        if block.t.size == 0:
            raise HardwareError(
                "delivers no samples",
                where=self.source.name,
                next_step="check that its sensors are switched on and connected, then go on with "
                "the same command",
            )
        if raw is not None:
            raw.write(block)
        return block

    def _distance(self, window: Block, pose: PlannedPose) -> str:
        """Say which joint has not arrived; empty if all have."""
        distance = np.abs(window.q.mean(axis=0) - pose.q)
        k = int(np.argmax(distance))
        if distance[k] <= self.criterion.arrival:
            return ""
        joint = self.robot.tree.joint_names[k]
        return (
            f"joint {joint} is not where the plan wants it "
            f"({distance[k]:.3g} rad (or m) off, limit {self.criterion.arrival:.3g})"
        )

    def _check_finished(self) -> None:
        """Refuse a plan whose numbers mean other poses than those that are finished."""
        measured = self.session.measured_positions(self.robot.tree.joint_names)
        for pose in self.plan:
            if pose.pose not in measured:
                continue
            distance = float(np.max(np.abs(measured[pose.pose] - pose.q), initial=0.0))
            if distance > self.criterion.arrival:
                raise ConfigError(
                    f"pose {pose.pose} of the plan is not the one that was recorded before",
                    where=str(self.session.poses_csv),
                    measured=f"a joint differs by {distance:.3g} rad (or m)",
                    limit=f"{self.criterion.arrival:.3g}",
                    next_step="number new poses on, or give a new folder with -s",
                )

    def _tasks(self, finished: Sequence[int]) -> list[_Task]:
        """Return what is left: planned poses, then repetitions, each in the order of the plan."""
        tasks = [_Task(i, p) for i, p in enumerate(self.plan) if p.pose not in finished]
        index = {pose.pose: i for i, pose in enumerate(self.plan)}
        repeated: list[_Task] = []
        for old, new in self.session.repetitions().items():
            index[new] = index.get(old, -1)  # a repetition may be repeated; a plan may be shorter
            if new not in finished and index[new] >= 0:
                i = index[new]
                repeated.append(_Task(i, replace(self.plan[i], pose=new)))
        return tasks + sorted(repeated, key=lambda task: task.index)
