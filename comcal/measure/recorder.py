# SPDX-License-Identifier: Apache-2.0
"""Recording: drive the planned poses, wait until the robot stands still, average, write down.

A pose is finished when its row is on the disk; its raw samples are there before. Whatever stops the
recording loses at most the pose in progress. Resuming sends the robot to the pose before the next
one first, so that every joint is approached from the same side as in one go: with a simulated
source, which derives its noise from seed and pose, both give the same rows, bit by bit.

At a real robot (:class:`~comcal.measure.guided.Guidance`) nobody is sent back: from which side each
joint came is seen on its encoder.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import ConfigError, NotStillError
from comcal.measure.counts import append_counts
from comcal.measure.guard import GuardedCommander
from comcal.measure.guided import Guidance, GuidedWait
from comcal.measure.operator import Person, Wish
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import approaches, pose_row
from comcal.measure.progress import (
    OnEvent,
    PoseFinished,
    PoseRepeated,
    PoseRetried,
    PoseSkipped,
    PoseStarted,
    RecordingStarted,
    RecordingSummary,
    ignore,
)
from comcal.measure.raw import RawWriter, raw_path
from comcal.measure.session import Session
from comcal.measure.source import Commander, CountingSource, PoseAwareSource, Source
from comcal.measure.still import StillCriterion
from comcal.measure.waiting import Waited, wait_until_still
from comcal.robot.model import Robot


@dataclass(frozen=True)
class _Task:
    """A pose to record; ``index`` is that of its row in the plan, whatever its id."""

    index: int
    pose: PlannedPose


@dataclass(frozen=True)
class _Outcome:
    """What became of a pose; ``wish`` is that of somebody who cut it short."""

    event: PoseFinished | PoseSkipped | None
    wish: Wish | None = None


def record(
    robot: Robot,
    source: Source,
    commander: Commander,
    plan: Sequence[PlannedPose],
    session: Session,
    criterion: StillCriterion | None = None,
    on_event: OnEvent = ignore,
    guidance: Guidance | None = None,
) -> RecordingSummary:
    """Record every pose of the plan that the session does not have yet.

    Parameters
    ----------
    robot : Robot
    source : Source
    commander : Commander
        With *guidance*: a :class:`~comcal.measure.operator.Person` or a
        :class:`~comcal.measure.guard.GuardedCommander`.
    plan : sequence of PlannedPose
    session : Session
        Poses noted there for repetition are measured again, under their new ids.
    criterion : StillCriterion or None
        None: the defaults.
    on_event : callable
        Called with what happens, as dataclasses of :mod:`comcal.measure.progress`.
    guidance : Guidance or None
        At a real robot. None: the robot is where it is sent at once, as in a simulation.

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
        If the source delivers nothing, or a commanded robot is too fast.
    UsageError
        If a pose cannot be commanded, or another recording runs in the same session.
    KeyboardInterrupt
        When interrupted, or when the operator wants to quit; everything finished is saved.
    """
    criterion = criterion or StillCriterion()
    guided: GuidedWait | None = None
    if guidance is not None:
        if not isinstance(commander, Person | GuardedCommander):
            raise TypeError("a guided recording needs a Person or a GuardedCommander")
        guided = GuidedWait(robot, source, commander, criterion, guidance, on_event)
    recorder = _Recorder(
        robot, source, commander, tuple(plan), session, criterion, on_event, guidance, guided
    )
    with ExitStack() as stack:
        if guidance is not None and guided is not None:
            is_commanded = isinstance(commander, GuardedCommander)
            stack.enter_context(guidance.operator.attend(guided.stop if is_commanded else None))
        try:
            return recorder.run()
        except BaseException:
            if guided is not None:
                guided.stop()
            raise


@dataclass(frozen=True)
class _Recorder:
    robot: Robot
    source: Source
    commander: Commander
    plan: tuple[PlannedPose, ...]
    session: Session
    criterion: StillCriterion
    on_event: OnEvent
    guidance: Guidance | None = None
    guided: GuidedWait | None = None

    def run(self) -> RecordingSummary:
        """Record; see :func:`record`."""
        with self.session.lock():
            before = self.session.finished_poses()
            self._check_finished()
            tasks = deque(self._tasks(before))
            self.on_event(RecordingStarted(len(before) + len(tasks), len(before)))
            recorded: list[int] = []
            skipped: list[PoseSkipped] = []
            standing: int | None = None
            while tasks:
                task = tasks.popleft()
                if self.guided is None and task.index > 0 and standing != task.index - 1:
                    self._placed(self.plan[task.index - 1], None)
                standing = task.index
                outcome = self._pose(task)
                if outcome.wish is Wish.QUIT:
                    raise KeyboardInterrupt
                if outcome.wish is Wish.REDO:
                    tasks.appendleft(task)
                    tasks.extendleft(self._repetition_of(recorded[-1:]))
                if isinstance(outcome.event, PoseSkipped):
                    skipped.append(outcome.event)
                elif outcome.event is not None:
                    recorded.append(task.pose.pose)
                if outcome.event is not None:
                    self.on_event(outcome.event)
        never = [pose for pose in skipped if not pose.by_operator]
        if never and not recorded and not before:
            raise NotStillError(
                f"no pose became still, the first because of: {never[0].reason}",
                where=f"pose {never[0].pose}",
                next_step="wait longer (--timeout), hold the robot stiffer, or relax the "
                "criterion (--still-sd, --still-window, --arrival)",
            )
        status = self.source.status() if isinstance(self.source, CountingSource) else None
        return RecordingSummary(tuple(recorded), before, tuple(skipped), status)

    def _pose(self, task: _Task) -> _Outcome:
        """Record one pose, trying twice."""
        pose = task.pose
        self.on_event(PoseStarted(pose.pose))
        waited = self._attempt(task)
        if waited.window is None and waited.wish is None:
            self.on_event(PoseRetried(pose.pose, waited.reason))
            waited = self._attempt(task)
        if waited.wish is Wish.SKIP:
            skipped = PoseSkipped(pose.pose, "left out by the operator", by_operator=True)
            return _Outcome(skipped, waited.wish)
        if waited.wish is not None:
            return _Outcome(None, waited.wish)
        if waited.window is None:
            return _Outcome(PoseSkipped(pose.pose, waited.reason))
        previous = self.plan[task.index - 1] if task.index > 0 else None
        self.session.append_pose(
            pose_row(
                pose,
                waited.window,
                self.robot,
                waited.sides or approaches(pose, previous, self.robot.tree.joint_names),
                with_floor=any(p.floor_roll or p.floor_pitch for p in self.plan),
                with_revisit=any(p.revisit for p in self.plan),
            )
        )
        if isinstance(self.source, CountingSource):
            append_counts(self.session.directory, pose.pose, self.source.status())
        return _Outcome(PoseFinished(pose.pose, waited.seconds, waited.window.t.size))

    def _attempt(self, task: _Task) -> Waited:
        if isinstance(self.source, PoseAwareSource):
            self.source.begin_pose(task.pose.pose)
        with RawWriter(raw_path(self.session.directory, task.pose.pose), self.robot) as raw:
            if self.guided is None or self.guidance is None:
                return self._placed(task.pose, raw)
            via = self.guidance.vias.get(self.plan[task.index].pose)
            return self.guided.wait(task.pose, via, raw)

    def _placed(self, pose: PlannedPose, raw: RawWriter | None) -> Waited:
        return wait_until_still(self.robot, self.source, self.commander, pose, self.criterion, raw)

    def _repetition_of(self, recorded: Sequence[int]) -> list[_Task]:
        """Return the task that repeats the last recorded pose; none if there is no such pose."""
        for pose in recorded:
            new = plan_repetition(self.session, self.plan, pose)
            self.on_event(PoseRepeated(pose, new))
            return [
                task for task in self._tasks(self.session.finished_poses()) if task.pose.pose == new
            ]
        return []

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


def plan_repetition(session: Session, plan: Sequence[PlannedPose], pose: int) -> int:
    """Note that a finished pose is to be measured again, under the next free id.

    Parameters
    ----------
    session : Session
    plan : sequence of PlannedPose
    pose : int
        Finished. One that waits for its repetition already gets no other.

    Returns
    -------
    int
        The id of the repetition.
    """
    finished = session.finished_poses()
    repetitions = session.repetitions()
    while pose in repetitions:
        pose = repetitions[pose]
    if pose not in finished:
        return pose
    new = max((*finished, *repetitions.values(), *(planned.pose for planned in plan))) + 1
    session.plan_repetition(pose, new)
    return new
