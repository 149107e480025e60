# SPDX-License-Identifier: Apache-2.0
"""``comcal record``: robot, plan and source brought together in a session folder."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from comcal.errors import UsageError
from comcal.measure.both_sides import BOTH, DEFAULT_VIA, both_sides
from comcal.measure.guard import GuardedCommander
from comcal.measure.guided import Guidance
from comcal.measure.operator import Person
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.progress import (
    OnEvent,
    PlanChanged,
    RecordingSummary,
    SidesMissing,
    SourceOpened,
    ignore,
)
from comcal.measure.recorder import plan_repetition, record
from comcal.measure.session import Session, is_session, open_session
from comcal.measure.source import Commander
from comcal.measure.still import StillCriterion
from comcal.robot.changes import Change, check_changes
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.commanders import CommanderOrder, open_commander
from comcal.workflow.session_source import SEED_BITS, OpenSession, SourceOrder, opened_session

__all__ = ["SEED_BITS", "RecordOrder", "RecordOutcome", "record_session"]


@dataclass(frozen=True)
class RecordOrder:
    """What to record.

    Parameters
    ----------
    robot_yaml, directory : Path
        The description and the session folder, new or begun before.
    source : str
        ``NAME`` or ``NAME:ARGUMENT``.
    plan : Path or None
        None: ``plan.csv`` beside ``robot_yaml``.
    redo : tuple of int
        Poses to measure again; their old rows stay, out of use.
    seed : int or None
        None: that of the session, else a fresh one.
    noise : bool
        False asks a simulated source for the engine's own values.
    criterion : StillCriterion
    timeout : float or None
        Instead of the criterion's, which is not for people: None lets a person take any time.
    changes : tuple of Change
        Effects to hide in a simulated source; what they are stays out of the session folder.
    argv : tuple of str
        The command typed, for the truth beside the folder.
    commander : CommanderOrder
        Who moves a robot that its source only measures.
    approach : str
        ``both``: every pose is approached from both sides; empty: as the plan has it.
    via : float
        How far beyond its pose a joint goes to arrive from a certain side [rad].
    """

    robot_yaml: Path
    directory: Path
    source: str
    plan: Path | None = None
    redo: tuple[int, ...] = ()
    seed: int | None = None
    noise: bool = True
    criterion: StillCriterion = field(default_factory=StillCriterion)
    changes: tuple[Change, ...] = ()
    argv: tuple[str, ...] = ()
    timeout: float | None = None
    commander: CommanderOrder = field(default_factory=CommanderOrder)
    approach: str = ""
    via: float = DEFAULT_VIA


@dataclass(frozen=True)
class RecordOutcome:
    """What was recorded, and where.

    Parameters
    ----------
    session : Session
    summary : RecordingSummary
    engine : str
        What the source says of itself.
    seed : int or None
        With it the same recording can be made again; None where nothing is simulated.
    """

    session: Session
    summary: RecordingSummary
    engine: str
    seed: int | None


def record_session(order: RecordOrder, on_event: OnEvent = ignore) -> RecordOutcome:
    """Record the poses of a plan into a session folder, going on where it was stopped.

    Parameters
    ----------
    order : RecordOrder
    on_event : callable
        Called with what happens.

    Raises
    ------
    UsageError
        If robot.yaml, plan, source, folder or a pose to repeat are not usable together.
    MissingExtraError
        If the source's engine is not installed.
    DataError, HardwareError, KeyboardInterrupt
        As :func:`comcal.measure.recorder.record`.
    """
    robot = load_robot(order.robot_yaml)
    check_changes(order.changes, robot)
    plan_path = order.plan or order.robot_yaml.parent / "plan.csv"
    plan = read_plan(plan_path, robot.tree.joint_names)
    if order.approach == BOTH:
        plan = both_sides(plan, robot.tree.joint_names)
    if is_session(order.directory):
        _check_approach(open_session(order.directory), order.approach)
    elif order.redo:
        raise UsageError(
            "there is nothing to measure again yet",
            where=str(order.directory),
            next_step="record it first, without --redo",
        )
    source_order = SourceOrder(
        order.directory, order.source, order.seed, order.noise, order.changes, order.argv
    )
    with ExitStack() as stack:
        opened = stack.enter_context(opened_session(source_order, robot, plan))
        session, source = opened.session, opened.source
        on_event(SourceOpened(order.source, source.name, opened.seed, opened.is_resumed))
        with session.lock():
            if not session.note_input(plan_path):
                on_event(PlanChanged(str(plan_path)))
            if session.metadata.get("approach", "") != order.approach:
                session.update(approach=order.approach)
            for pose in order.redo:
                _order_repetition(session, plan, pose)
            commander, guidance = _mover(order, robot, plan, opened, on_event, stack)
            summary = record(
                robot,
                source,
                commander,
                plan,
                session,
                _criterion(order, commander),
                on_event,
                guidance,
            )
    return RecordOutcome(session, summary, source.name, opened.seed)


def _mover(
    order: RecordOrder,
    robot: Robot,
    plan: tuple[PlannedPose, ...],
    opened: OpenSession,
    on_event: OnEvent,
    stack: ExitStack,
) -> tuple[Commander, Guidance | None]:
    """Return who moves the robot, and how the recording is led; None: by itself.

    Raises
    ------
    UsageError
        If a commander is asked for although the source moves what it measures.
    """
    source = opened.source
    if isinstance(source, Commander):
        if order.commander.name:
            raise UsageError(
                f"the source {order.source} moves the robot itself",
                where=f"--commander {order.commander.name}",
                next_step="leave it out",
            )
        return source, None
    # Imported late: scipy's geometry takes longer to load than a simulation of a few poses.
    from comcal.workflow.via_poses import via_poses

    vias = via_poses(robot, plan, order.via)
    if vias.without_room:
        on_event(SidesMissing(vias.without_room))
    guidance = Guidance(order.commander.operator, vias.poses, opened.session.tares())
    if not order.commander.name:
        return Person(), guidance
    everything = (*plan, *vias.poses.values())
    commander = open_commander(
        order.commander, robot, everything, source, lambda c: _closed_at_end(stack, c)
    )
    return commander, guidance


def _closed_at_end(stack: ExitStack, commander: GuardedCommander) -> None:
    stack.callback(commander.close)


def _criterion(order: RecordOrder, commander: Commander) -> StillCriterion:
    """Return the criterion with the time-out that suits whoever moves the robot."""
    if order.timeout is not None:
        return replace(order.criterion, timeout=order.timeout)
    if isinstance(commander, Person):
        return replace(order.criterion, timeout=math.inf)
    return order.criterion


def _check_approach(session: Session, approach: str) -> None:
    """Refuse to mix poses that are numbered once with poses that are numbered twice.

    Raises
    ------
    UsageError
        If the finished poses were approached in another way.
    """
    known = session.metadata.get("approach", "")
    if known == approach or not session.finished_poses():
        return
    raise UsageError(
        f"this session was begun {'with' if known else 'without'} --approach {known or approach}",
        where=str(session.directory),
        next_step=f"{'add' if known else 'leave out'} it, or give a new folder with -s",
    )


def _order_repetition(session: Session, plan: tuple[PlannedPose, ...], pose: int) -> None:
    """Give the repetition of *pose* the next free id, unless it waits for one already."""
    finished = session.finished_poses()
    if pose not in finished or pose not in {planned.pose for planned in plan}:
        raise UsageError(
            f"pose {pose} is not "
            + ("in the plan" if pose in finished else "finished, so it cannot be repeated"),
            where="--redo",
            next_step="give the number of a finished pose of this plan",
        )
    plan_repetition(session, plan, pose)
