# SPDX-License-Identifier: Apache-2.0
"""Reading until the robot stands still where it was sent, or for too long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from comcal.errors import HardwareError, NotReachedError
from comcal.measure.operator import Wish
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import cut, join
from comcal.measure.raw import RawWriter
from comcal.measure.source import Block, Commander, Source
from comcal.measure.still import StillCriterion, judge_stillness
from comcal.robot.model import Robot
from comcal.robot.tree import Array

STEP = 0.2
"""Seconds that are read between two looks for a still window."""


@dataclass(frozen=True)
class Waited:
    """How a wait ended.

    Parameters
    ----------
    window : Block or None
        The still window; None: there was none, for this ``reason`` or because of this ``wish``.
    seconds : float
        It took [s], in the source's clock.
    reason : str
    wish : Wish or None
        Of somebody who did not want to wait any longer.
    sides : mapping from joint name to int or None, or None
        From which side every joint came, where that was seen.
    """

    window: Block | None
    seconds: float = 0.0
    reason: str = ""
    wish: Wish | None = None
    sides: dict[str, int | None] | None = field(default=None)


def wait_until_still(
    robot: Robot,
    source: Source,
    commander: Commander,
    pose: PlannedPose,
    criterion: StillCriterion,
    raw: RawWriter | None,
) -> Waited:
    """Send a robot to *pose* that arrives by itself, and wait until it stands still there.

    Parameters
    ----------
    robot : Robot
    source : Source
    commander : Commander
    pose : PlannedPose
    criterion : StillCriterion
    raw : RawWriter or None
        Takes every sample.

    Returns
    -------
    Waited
        Without a window also where a log never comes to the pose.

    Raises
    ------
    HardwareError
        If the source delivers nothing.
    UsageError
        If the pose cannot be commanded.
    """
    try:
        return _placed(robot, source, commander, pose, criterion, raw)
    except NotReachedError as error:  # who shows the reason names the pose
        return Waited(None, reason=str(error).removeprefix(f"{error.where}: "))


def _placed(
    robot: Robot,
    source: Source,
    commander: Commander,
    pose: PlannedPose,
    criterion: StillCriterion,
    raw: RawWriter | None,
) -> Waited:
    commander.move_to(pose)
    needed = max(criterion.settle, criterion.window)
    blocks = [read_samples(source, needed, raw)]
    start = float(blocks[0].t[0])
    while True:
        block = join(blocks)
        judged = judge_stillness(block, robot, pose.support, criterion)
        reason = judged.reason
        if judged.window is not None:
            window = cut(block, judged.window)
            reason = distance_left(window.q.mean(axis=0), pose, robot, criterion.arrival)
            if not reason:
                return Waited(window, float(window.t[-1]) - start)
        if float(block.t[-1]) - start >= criterion.timeout:
            return Waited(None, reason=reason)
        blocks = [*recent_blocks(blocks, criterion), read_samples(source, STEP, raw)]


def recent_blocks(blocks: Sequence[Block], criterion: StillCriterion) -> list[Block]:
    """Drop blocks that are too old to matter for a window yet to come."""
    c = criterion
    t = np.concatenate([block.t for block in blocks])
    longest = max(c.window, c.min_samples * float(np.median(np.diff(t))) if t.size > 1 else 0.0)
    oldest = float(t[-1]) - c.settle - longest
    return [block for block in blocks if float(block.t[-1]) > oldest]


def read_samples(source: Source, duration: float, raw: RawWriter | None = None) -> Block:
    """Read, and refuse to read nothing.

    Raises
    ------
    HardwareError
        If the source delivers nothing.
    """
    block = source.read(duration)
    if block.t.size == 0:
        raise HardwareError(
            "delivers no samples",
            where=source.name,
            next_step="check that its sensors are switched on and connected, then go on with "
            "the same command",
        )
    if raw is not None:
        raw.write(block)
    return block


def distance_left(q: Array, pose: PlannedPose, robot: Robot, arrival: float) -> str:
    """Say which joint has not arrived; empty if all have.

    Parameters
    ----------
    q : array, shape (n_joints,)
        Mean over the still window [rad] or [m].
    pose : PlannedPose
    robot : Robot
    arrival : float
        Largest distance of a joint [rad] or [m].
    """
    distance = np.abs(q - pose.q)
    k = int(np.argmax(distance))
    if distance[k] <= arrival:
        return ""
    joint = robot.tree.joint_names[k]
    return (
        f"joint {joint} is not where the plan wants it "
        f"({distance[k]:.3g} rad (or m) off, limit {arrival:.3g})"
    )
