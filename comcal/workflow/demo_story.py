# SPDX-License-Identifier: Apache-2.0
"""What a demo does with its session: calibrate, diagnose, mend the model, measure the gain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from comcal.errors import ComcalError, DataError, UsageError
from comcal.identify.calibration import Calibration
from comcal.measure.session import Session
from comcal.report.demo import DemoStory
from comcal.report.rerun import RerunGain
from comcal.workflow.calibrate import load_session, solve_session
from comcal.workflow.diagnose import Diagnosed, diagnose_session
from comcal.workflow.known_model import KnownModel, read_model
from comcal.workflow.rerun import rerun_gain

_T = TypeVar("_T")

_BOOTSTRAP = 2
"""Random stream of a demo's seed, beside those of the sensors and of the fault."""


def tell_story(session: Session, source: str, held_out: Sequence[int], seed: int) -> DemoStory:
    """Find out what is wrong with the model of a session, and what mending it is worth.

    Works from the session folder alone, and writes its results there.

    Parameters
    ----------
    session : Session
    source : str
        Simulator that runs the physics again.
    held_out : sequence of int
        Ids of poses that take no part in what is fitted; those that were not recorded are ignored.
    seed : int

    Raises
    ------
    DataError
        If the readings leave nothing to diagnose.
    """
    # Small matrices: threads would only wait for one another.
    with threadpool_limits(limits=1):
        return _told(session, source, held_out, seed)


def _told(session: Session, source: str, held_out: Sequence[int], seed: int) -> DemoStory:
    recorded = load_session(session.directory, doubtful=True)[2].pose
    fresh = tuple(pose for pose in held_out if pose in recorded)
    notes = list[str]()
    nominal = _tried(lambda: _calibration(session, fresh), notes)
    diagnosed = diagnose_session(session.directory, drop=fresh)
    page = _file(diagnosed, "report.html")
    story = DemoStory(diagnosed.diagnosis, fresh, nominal, None, None, page)
    if diagnosed.diagnosis.changes:
        model = read_model(_file(diagnosed, "extended.yaml"))
        story = replace(
            story,
            extended=_tried(lambda: _calibration(session, fresh, model), notes),
            rerun=_tried(lambda: _rerun(diagnosed, source, fresh, seed), notes),
        )
    return replace(story, notes=tuple(dict.fromkeys(notes)))


def _calibration(
    session: Session, fresh: tuple[int, ...], model: KnownModel | None = None
) -> Calibration:
    return solve_session(session.directory, held_out=fresh, model=model).calibration


def _rerun(diagnosed: Diagnosed, source: str, fresh: tuple[int, ...], seed: int) -> RerunGain:
    _, robot, table = load_session(diagnosed.session.directory, doubtful=True)
    rows = [i for i, pose in enumerate(table.pose) if pose in fresh]
    rng = np.random.default_rng((seed, _BOOTSTRAP))
    return rerun_gain(robot, table, source, diagnosed.diagnosis.changes, rng, chosen=rows)


def _tried(work: Callable[[], _T], notes: list[str]) -> _T | None:
    """Do a part of the story that some faults make impossible, and note why."""
    try:
        return work()
    except (UsageError, DataError) as reason:
        notes.append(_words(reason))
        return None


def _words(reason: ComcalError) -> str:
    return f"{reason.where}: {reason.what}" if reason.where else reason.what


def _file(diagnosed: Diagnosed, name: str) -> Path:
    return next(path for path in diagnosed.files if path.name == name)
