# SPDX-License-Identifier: Apache-2.0
"""Waiting at a real robot, which a person or a guarded commander brings to the planned pose.

Nothing tells when the robot has arrived but its own encoders, and nothing limits how long a person
takes. A pose is accepted by the same rules of stillness as in a simulation; besides, the robot must
have come more than half of the way from where it was before, or a pose close to the last one would
be taken for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from comcal.measure.guard import GuardedCommander
from comcal.measure.observe import Look, observe, temperatures_of
from comcal.measure.operator import Nobody, Operator, Person
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import NOT_MOVED, cut, join
from comcal.measure.progress import OnEvent, PoseObserved
from comcal.measure.raw import RawWriter
from comcal.measure.reading import Tares, mean_of
from comcal.measure.source import Block, CountingSource, Source
from comcal.measure.still import StillCriterion, judge_stillness
from comcal.measure.travel import Travel
from comcal.measure.waiting import STEP, Waited, distance_left, read_samples, recent_blocks
from comcal.robot.model import Robot
from comcal.robot.tree import Array

RAW_KEPT = 10.0
"""Seconds before the end of the still window whose raw samples are kept: a person may take minutes
from pose to pose."""

BEYOND = 0.5
"""A joint counts as beyond its pose from this part of the planned way on."""

PAUSE = 5e-3
"""A commanded joint that moves less during a step has arrived at a via-pose [rad] or [m]."""

HURRY = 1.5
"""A commanded robot may take this times as long as its speed limit needs at least."""


@dataclass(frozen=True)
class Guidance:
    """How a recording on a real robot is led.

    Parameters
    ----------
    operator : Operator
        Who attends it.
    vias : mapping from pose id to PlannedPose
        Places beyond the poses of the plan that are approached from a certain side.
    tares : mapping from sensor name to (value, sigma)
        For showing; rows hold what the sensors report.
    """

    operator: Operator = field(default_factory=Nobody)
    vias: Mapping[int, PlannedPose] = field(default_factory=dict[int, PlannedPose])
    tares: Tares = field(default_factory=dict[str, tuple[Array, Array]])


class GuidedWait:
    """Waits for one pose after the other, and remembers how the robot came there.

    Parameters
    ----------
    robot : Robot
    source : Source
    commander : GuardedCommander or Person
    criterion : StillCriterion
        An infinite ``timeout`` waits for ever.
    guidance : Guidance
    on_event : callable
    """

    def __init__(
        self,
        robot: Robot,
        source: Source,
        commander: GuardedCommander | Person,
        criterion: StillCriterion,
        guidance: Guidance,
        on_event: OnEvent,
    ) -> None:
        self._robot = robot
        self._source = source
        self._commander = commander
        self._criterion = criterion
        self._guidance = guidance
        self._on_event = on_event
        self._travel = Travel(len(robot.tree.joint_names))
        self._was_accepted = False
        self._via: PlannedPose | None = None
        self._left: Array | None = None  # where the robot was before this leg
        self._first_temperatures: dict[str, float] = {}

    def stop(self) -> None:
        """Stop a robot that is commanded."""
        if isinstance(self._commander, GuardedCommander):
            self._commander.stop()

    def wait(self, pose: PlannedPose, via: PlannedPose | None, raw: RawWriter) -> Waited:
        """Wait until the robot stands still in *pose*, having been beyond it at *via*.

        Parameters
        ----------
        pose : PlannedPose
        via : PlannedPose or None
        raw : RawWriter
            Takes the samples up to the still window, once there is one.

        Returns
        -------
        Waited

        Raises
        ------
        HardwareError
            If the source delivers nothing, or a commanded robot is too fast.
        UsageError
            If the pose cannot be commanded.
        KeyboardInterrupt
            If the robot was stopped.
        """
        self._via = via
        if via is not None:
            waited = self._leg(via, pose, raw)
            if waited.wish is not None or waited.reason:
                return waited
        waited = self._leg(pose, None, raw)
        if waited.window is None:
            return waited
        self._left = waited.window.q.mean(axis=0)
        sides = self._sides()
        self._travel.begin()
        self._was_accepted = True
        return Waited(waited.window, waited.seconds, sides=sides)

    def _leg(self, target: PlannedPose, beyond: PlannedPose | None, raw: RawWriter) -> Waited:
        """Wait until *target* is reached; as a via-pose, if it lies beyond another one."""
        self._commander.move_to(target)
        blocks: list[Block] = []
        start = patience = 0.0
        while True:
            block = read_samples(self._source, STEP)
            self._follow(block)
            if not blocks:
                start = float(block.t[0])
                patience = self._criterion.timeout + self._shortest(mean_of(block.q), target)
            blocks = [b for b in blocks if float(b.t[-1]) > float(block.t[-1]) - RAW_KEPT]
            blocks.append(block)
            recent = join(recent_blocks(blocks, self._criterion))
            waited = float(block.t[-1]) - start
            if beyond is not None:
                found, reason = None, self._not_beyond(block, target, beyond)
            else:
                found, reason = self._judge(recent, target)
            self._show(Look(target, beyond is not None, waited, reason), recent)
            if not reason:
                self._left = mean_of(block.q)
                if found is not None:
                    raw.write(join(blocks))
                    return Waited(found, float(found.t[-1]) - start)
                return Waited(None)
            wish = self._guidance.operator.wish()
            if wish is not None or waited >= patience:
                return Waited(None, waited, reason, wish)

    def _follow(self, block: Block) -> None:
        if isinstance(self._commander, GuardedCommander):
            self._commander.watch(block)
        self._travel.follow(block.q)
        for name, value in temperatures_of(block).items():
            self._first_temperatures.setdefault(name, value)

    def _shortest(self, q: Array, target: PlannedPose) -> float:
        """Return how long a commanded robot is on its way [s]; a person's way is not known."""
        if not isinstance(self._commander, GuardedCommander):
            return 0.0
        way = float(np.max(np.nan_to_num(np.abs(q - target.q)), initial=0.0))
        return HURRY * way / self._commander.speed

    def _judge(self, recent: Block, pose: PlannedPose) -> tuple[Block | None, str]:
        """Return the still window if the robot is there, else why not."""
        judged = judge_stillness(recent, self._robot, pose.support, self._criterion)
        if judged.window is None:
            newest = mean_of(recent.q[-max(1, len(recent.q) // 4) :])
            away = distance_left(newest, pose, self._robot, self._criterion.arrival)
            return None, away or judged.reason
        window = cut(recent, judged.window)
        q = window.q.mean(axis=0)
        reason = (
            distance_left(q, pose, self._robot, self._criterion.arrival)
            or self._not_left(q, pose)
            or self._wrong_side(pose)
        )
        return (None, reason) if reason else (window, "")

    def _not_left(self, q: Array, pose: PlannedPose) -> str:
        """Say that the robot is nearer to where it was before; empty if it is not."""
        if self._left is None:
            return ""
        way = pose.q - self._left
        if np.abs(way).max(initial=0.0) < PAUSE or (q - self._left) @ way >= 0.5 * way @ way:
            return ""
        k = int(np.argmax(np.abs(way)))
        return (
            f"the robot still stands in the pose before: joint "
            f"{self._robot.tree.joint_names[k]} has {abs(way[k]):.3g} rad (or m) to go"
        )

    def _wrong_side(self, pose: PlannedPose) -> str:
        """Say which joint a person brought there from the wrong side; empty if none.

        A commanded robot has no other way to offer: what it did is written down.
        """
        if self._via is None or isinstance(self._commander, GuardedCommander):
            return ""
        moves = np.abs(self._via.q - pose.q) >= NOT_MOVED
        for k, joint in enumerate(self._robot.tree.joint_names):
            side = pose.approach.get(joint, 0)
            if side and moves[k] and self._travel.sides[k] == -side:
                way = "increasing" if side > 0 else "decreasing"
                return f"joint {joint} is to arrive {way}: go back a little and come again"
        return ""

    def _not_beyond(self, block: Block, via: PlannedPose, pose: PlannedPose) -> str:
        """Say which joint is not yet beyond its pose; empty if all are."""
        offset = via.q - pose.q
        gone = (mean_of(block.q) - pose.q) * np.sign(offset)
        lacking = np.where(np.abs(offset) >= NOT_MOVED, BEYOND * np.abs(offset) - gone, -1.0)
        k = int(np.argmax(np.nan_to_num(lacking, nan=np.inf)))
        if not lacking[k] <= 0.0:
            joint = self._robot.tree.joint_names[k]
            return f"joint {joint} first has to go beyond its place, to {via.q[k]:.3f} rad (or m)"
        moving = np.abs(block.q[-1] - block.q[0])
        if isinstance(self._commander, GuardedCommander) and moving.max(initial=0.0) > PAUSE:
            return "the robot is on its way to the place beyond"
        return ""

    def _sides(self) -> dict[str, int | None]:
        """Return from which side every joint came since the last pose; None: not seen."""
        names = self._robot.tree.joint_names
        unmoved = 0 if self._was_accepted else None
        return {
            name: side or unmoved
            for name, side in zip(names, self._travel.sides.tolist(), strict=True)
        }

    def _show(self, look: Look, recent: Block) -> None:
        status = self._source.status() if isinstance(self._source, CountingSource) else None
        shown = Look(
            look.pose,
            look.is_via,
            look.waited,
            look.reason,
            status,
            self._guidance.tares,
            self._first_temperatures,
        )
        self._on_event(PoseObserved(observe(shown, recent, self._robot, self._criterion)))
