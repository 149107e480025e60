# SPDX-License-Identifier: Apache-2.0
"""``comcal record``: robot, plan and source brought together in a session folder."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field, replace
from pathlib import Path

from comcal.errors import UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.progress import (
    OnEvent,
    PlanChanged,
    RecordingSummary,
    SourceOpened,
    ignore,
)
from comcal.measure.recorder import record
from comcal.measure.session import (
    Session,
    check_same_experiment,
    create_session,
    is_session,
    open_session,
)
from comcal.measure.source import SimulatedSource, SourceRequest
from comcal.measure.still import StillCriterion
from comcal.robot.changes import Change, check_changes
from comcal.robot.changes_text import change_text
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.sealed import SEAL, Truth, refuse_old_truth, reopened_truth, write_truth
from comcal.workflow.sources import open_source

SEED_BITS = 32


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
    changes : tuple of Change
        Effects to hide in a simulated source; what they are stays out of the session folder.
    argv : tuple of str
        The command typed, for the truth beside the folder.
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


@dataclass(frozen=True)
class RecordOutcome:
    """What was recorded, and where.

    Parameters
    ----------
    session : Session
    summary : RecordingSummary
    engine : str
        What the source says of itself.
    seed : int
        With it the same recording can be made again.
    """

    session: Session
    summary: RecordingSummary
    engine: str
    seed: int


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
    is_resumed = is_session(order.directory)
    truth: Truth | None = None
    # Everything that can be refused is refused before the source, perhaps a robot, is touched.
    if is_resumed:
        order, truth = _resumed(order, robot)
    elif order.redo:
        raise UsageError(
            "there is nothing to measure again yet",
            where=str(order.directory),
            next_step="record it first, without --redo",
        )
    else:
        refuse_old_truth(order.directory)
    seed = secrets.randbits(SEED_BITS) if order.seed is None else order.seed
    begins = order.changes and truth is None
    if begins:
        truth = Truth(seed, order.changes, argv=order.argv)
    with _opened(order, robot, seed, plan) as source:
        details: dict[str, object] = {"engine": source.name, "noise": order.noise}
        if truth is not None:
            details[SEAL] = truth.seal()
        session = create_session(
            order.directory,
            robot,
            source=order.source,
            seed=seed if truth is None else None,
            details=details,
        )
        if begins and truth is not None:
            write_truth(order.directory, truth)
        on_event(SourceOpened(order.source, source.name, seed, is_resumed))
        with session.lock():
            if not session.note_input(plan_path):
                on_event(PlanChanged(str(plan_path)))
            for pose in order.redo:
                _plan_repetition(session, plan, pose)
            summary = record(robot, source, source, plan, session, order.criterion, on_event)
    return RecordOutcome(session, summary, source.name, seed)


def _resumed(order: RecordOrder, robot: Robot) -> tuple[RecordOrder, Truth | None]:
    """Return the order with the seed of the session, and what it hides, if it is the same work."""
    session = open_session(order.directory)
    truth = reopened_truth(order.directory, session.metadata, order.changes, order.seed)
    check_same_experiment(session, robot, order.source, order.seed if truth is None else None)
    noise = session.metadata.get("noise")
    if noise != order.noise:
        raise UsageError(
            f"this session was begun {'with' if noise else 'without'} noise",
            where=str(order.directory),
            next_step=f"{'leave out' if noise else 'add'} --no-noise, or give a new folder with -s",
        )
    return replace(order, seed=session.seed if truth is None else truth.seed), truth


def _opened(
    order: RecordOrder, robot: Robot, seed: int, plan: tuple[PlannedPose, ...]
) -> SimulatedSource:
    name, _, argument = order.source.partition(":")
    options = robot.sources.get(name)
    return open_source(
        name,
        SourceRequest(
            robot=robot,
            seed=seed,
            argument=argument,
            effects=tuple(change_text(change) for change in order.changes),
            noise=order.noise,
            options=options,
            directory=order.directory,
            plan=plan,
        ),
    )


def _plan_repetition(session: Session, plan: tuple[PlannedPose, ...], pose: int) -> None:
    """Give the repetition of *pose* the next free id, unless it waits for one already."""
    finished = session.finished_poses()
    repetitions = session.repetitions()
    if pose not in finished or pose not in {planned.pose for planned in plan}:
        raise UsageError(
            f"pose {pose} is not "
            + ("in the plan" if pose in finished else "finished, so it cannot be repeated"),
            where="--redo",
            next_step="give the number of a finished pose of this plan",
        )
    while pose in repetitions:
        pose = repetitions[pose]
    if pose in finished:
        used = (*finished, *repetitions.values(), *(planned.pose for planned in plan))
        session.plan_repetition(pose, max(used) + 1)
