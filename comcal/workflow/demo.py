# SPDX-License-Identifier: Apache-2.0
"""``comcal demo``: a simulated biped is generated, measured and solved in one go."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from comcal.errors import MissingExtraError, UsageError
from comcal.measure.progress import OnEvent, ignore
from comcal.workflow.calibrate import Solved, solve_session
from comcal.workflow.record import RecordOrder, record_session
from comcal.workflow.robots import robot_generator

ENGINES = ("pybullet", "mujoco")
"""In order of preference; without any of them the built-in statics serve."""
BUILTIN = "builtin"
FOLDER = "comcal-demo"


@dataclass(frozen=True)
class EngineChoice:
    """The source of a demo and, in words, why it was taken."""

    source: str
    why: str


@dataclass(frozen=True)
class Demo:
    """What a demo made.

    Parameters
    ----------
    directory : Path
        Holds ``robot/`` and ``session/``.
    """

    choice: EngineChoice
    seed: int
    directory: Path
    robot_yaml: Path
    solved: Solved


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
    parent: Path,
    robot: str = "table1",
    source: str | None = None,
    seed: int | None = None,
    on_choice: Callable[[EngineChoice], None] = lambda _: None,
    on_event: OnEvent = ignore,
) -> Demo:
    """Generate a robot, record its plan in simulation, solve the session.

    Parameters
    ----------
    parent : Path
        Folder in which the first free of ``comcal-demo``, ``comcal-demo-2``, ... is made.
    robot : str
        Entry point of the group ``comcal.robots``.
    source : str or None
        None: the best engine that is installed.
    seed : int or None
        None: a fresh one.
    on_choice, on_event : callable
        Told of the engine chosen, then of the recording as it goes.

    Raises
    ------
    UsageError
        If there is no such robot.
    MissingExtraError
        If *source* is not installed, or the simulated robots are not.
    """
    choice = choose_engine(source)
    on_choice(choice)
    generate = robot_generator(robot)
    directory = _free_folder(parent)
    robot_yaml = generate(directory / "robot")
    order = RecordOrder(robot_yaml, directory / "session", choice.source, seed=seed)
    try:
        outcome = record_session(order, on_event)
    except (UsageError, MissingExtraError):
        shutil.rmtree(directory)  # made a moment ago, and nothing was measured
        raise
    solved = solve_session(outcome.session.directory)
    return Demo(choice, outcome.seed, directory, robot_yaml, solved)


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
