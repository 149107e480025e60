# SPDX-License-Identifier: Apache-2.0
"""``comcal demo``: a simulated biped hides a fault, is measured, diagnosed, mended and judged."""

from __future__ import annotations

import secrets
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from comcal.errors import MissingExtraError, UsageError
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.plan_csv import read_plan, write_plan
from comcal.measure.progress import OnEvent, ignore
from comcal.measure.session import Session
from comcal.report.demo import DemoStory
from comcal.report.demo_truth import Judgement, judge
from comcal.robot.changes import Change
from comcal.robot.changes_text import parse_change
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.demo_fault import draw_fault
from comcal.workflow.demo_story import tell_story
from comcal.workflow.record import SEED_BITS, RecordOrder, record_session
from comcal.workflow.robots import robot_generator
from comcal.workflow.sealed import read_truth, truth_path

ENGINES = ("pybullet", "mujoco")
"""In order of preference; without any of them the built-in statics serve."""
BUILTIN = "builtin"
ROBOT = "biped14"
FOLDER = "comcal-demo"
NOTHING = "none"
"""The effect that is none: nothing is hidden."""
POSES = 28
"""Poses of the plan that are measured, at most: the rest would only take longer."""
HELD_OUT_EVERY = 4
"""One standing pose of so many takes no part, and shows later what the extended model is worth."""
_DRAWS = 1
"""Random stream of a demo's seed, beside those of the sensors."""


@dataclass(frozen=True)
class EngineChoice:
    """The source of a demo and, in words, why it was taken."""

    source: str
    why: str


@dataclass(frozen=True)
class DemoOrder:
    """What a demo is to do.

    Parameters
    ----------
    parent : Path
        Folder in which the first free of ``comcal-demo``, ``comcal-demo-2``, ... is made.
    robot : str
        Entry point of the group ``comcal.robots``.
    source : str or None
        None: the best engine that is installed.
    seed : int or None
        Of the fault and of the noise; None: a fresh one.
    effects : tuple of str
        What to hide, as typed after ``--effect``; ``none`` alone hides nothing. Empty: one fault,
        drawn.
    """

    parent: Path
    robot: str = ROBOT
    source: str | None = None
    seed: int | None = None
    effects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Begun:
    """What is told of a demo before it measures.

    Parameters
    ----------
    poses : int
        How many will be measured.
    """

    choice: EngineChoice
    robot: Robot
    poses: int
    seed: int


@dataclass(frozen=True)
class Demo:
    """What a demo made, and how it compares with what was hidden.

    Parameters
    ----------
    directory : Path
        Holds ``robot/``, ``session/`` and ``session.truth.yaml``.
    """

    begun: Begun
    directory: Path
    session: Session
    story: DemoStory
    judgement: Judgement


def choose_engine(wanted: str | None = None) -> EngineChoice:
    """Return *wanted*, or the best engine that is installed."""
    if wanted:
        return EngineChoice(wanted, "it was asked for")
    missing = [engine for engine in ENGINES if find_spec(engine) is None]
    present = next((engine for engine in ENGINES if engine not in missing), None)
    if present == ENGINES[0]:
        return EngineChoice(present, "it is installed")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    reason = f"{ENGINES[0]} is not installed (wheels exist up to Python 3.11; this is {version})"
    if present:
        return EngineChoice(present, reason)
    return EngineChoice(BUILTIN, f"neither {' nor '.join(ENGINES)} is installed")


def run_demo(
    order: DemoOrder,
    on_begin: Callable[[Begun], None] = lambda _: None,
    on_event: OnEvent = ignore,
) -> Demo:
    """Hide a fault in a generated robot, measure it, say what is wrong, and what mending gains.

    What is hidden goes into the simulator and into the truth beside the session; everything after
    the recording works from the session folder alone. The truth is read when all is on disk.

    Parameters
    ----------
    order : DemoOrder
    on_begin, on_event : callable
        Told of what is about to be measured, then of the recording as it goes.

    Raises
    ------
    UsageError
        If there is no such robot, or an effect is not valid for it.
    MissingExtraError
        If the source is not installed, or the simulated robots are not.
    DataError
        If what is hidden leaves nothing to diagnose.
    """
    generate = robot_generator(order.robot)
    typed = _typed(order.effects)
    choice = choose_engine(order.source)
    seed = secrets.randbits(SEED_BITS) if order.seed is None else order.seed
    directory = _free_folder(order.parent)
    try:
        robot_yaml = generate(directory / "robot")
        robot = load_robot(robot_yaml)
        names = robot.tree.joint_names
        poses = chosen_poses(read_plan(robot_yaml.with_name("plan.csv"), names))
        plan = directory / "plan.csv"
        write_plan(plan, poses, names)
        hidden = typed
        if typed is None:
            hidden = (draw_fault(robot, np.random.default_rng((seed, _DRAWS))),)
        begun = Begun(choice, robot, len(poses), seed)
        on_begin(begun)
        recording = RecordOrder(
            robot_yaml,
            directory / "session",
            choice.source,
            plan=plan,
            seed=seed,
            changes=hidden or (),
        )
        session = record_session(recording, on_event).session
    except (UsageError, MissingExtraError):
        shutil.rmtree(directory)  # made a moment ago, and nothing was measured
        raise
    story = tell_story(session, choice.source, held_out(poses), seed)
    return Demo(begun, directory, session, story, judge(_truth(session), story.diagnosis))


def chosen_poses(plan: Sequence[PlannedPose]) -> tuple[PlannedPose, ...]:
    """Return the poses of a plan that a demo has time for, spread evenly over it.

    Parameters
    ----------
    plan : sequence of PlannedPose
    """
    if len(plan) <= POSES:
        return tuple(plan)
    rows = np.linspace(0, len(plan) - 1, POSES).round().astype(int)
    return tuple(plan[i] for i in rows)


def held_out(poses: Sequence[PlannedPose]) -> tuple[int, ...]:
    """Return the ids of the poses that take no part in what is fitted.

    Parameters
    ----------
    poses : sequence of PlannedPose
    """
    standing = [pose.pose for pose in poses if pose.support != NONE]
    return tuple(standing[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY])


def _typed(effects: Sequence[str]) -> tuple[Change, ...] | None:
    """Return what somebody asked to hide; None: nobody did."""
    if not effects:
        return None
    if NOTHING not in effects:
        return tuple(map(parse_change, effects))
    if len(effects) > 1:
        raise UsageError(
            f"{NOTHING} hides nothing, and cannot be hidden beside something",
            where=f"--effect {NOTHING}",
            next_step="leave it out, or leave the others out",
        )
    return ()


def _truth(session: Session) -> tuple[Change, ...]:
    """Return what the session hides; without a truth beside it, nothing."""
    there = truth_path(session.directory).exists()
    return read_truth(session.directory).changes if there else ()


def _free_folder(parent: Path) -> Path:
    """Make and return the first folder of its kind that does not exist yet."""
    number = 1
    while True:
        folder = parent / (FOLDER if number == 1 else f"{FOLDER}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
            continue
        return folder
