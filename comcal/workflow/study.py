# SPDX-License-Identifier: Apache-2.0
"""``comcal study``: robots x noise x seeds, each calibrated and compared with its truth."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from comcal.errors import DataError
from comcal.identify.coverage import Trials
from comcal.identify.quantities import units
from comcal.identify.study_verdict import StudyLimits, StudySummary, summarise
from comcal.robot.locate import LocatedYaml
from comcal.robot.tree import Array
from comcal.workflow.study_bound import bound_of, read_bounds
from comcal.workflow.study_file import NoiseSection, StudyFile, read_study
from comcal.workflow.study_pool import run_in_processes
from comcal.workflow.study_results import StudyFolder, digest_of
from comcal.workflow.study_robot import StudyRobot, prepare_robot
from comcal.workflow.study_trial import Trial, TrialKey, run_trials

BATCH = 5
"""Calibrations that a worker does between two words with the parent."""

OnProgress = Callable[[int, int], None]


def ignore(_done: int, _total: int) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class StudyOrder:
    """What to run.

    Parameters
    ----------
    path : Path
        The study file.
    output : Path or None
        Folder of the results; None: as the file says, else its name, in the current folder.
    workers : int or None
        None: as the file says, else one per core.
    limit : int or None
        Only so many calibrations of each robot, noise and master seed.
    """

    path: Path
    output: Path | None = None
    workers: int | None = None
    limit: int | None = None


@dataclass(frozen=True)
class StudyOutcome:
    """A study that has run, and where its results are."""

    directory: Path
    before: int
    summary: StudySummary


@dataclass(frozen=True)
class _Cell:
    """One robot with one noise and its calibrations."""

    subject: StudyRobot
    noise: NoiseSection
    keys: tuple[TrialKey, ...]
    bound: Array


def run_study(order: StudyOrder, on_progress: OnProgress = ignore) -> StudyOutcome:
    """Run what is missing of a study and summarise all of it.

    Parameters
    ----------
    order : StudyOrder
    on_progress : callable
        Called with the number of finished calibrations and of all.

    Raises
    ------
    ConfigError
        If the study file, a robot or a file of bounds is missing or wrong.
    UsageError
        If the output folder belongs to another study, or another process writes there.
    DataError
        If the results in the folder are damaged, or no calibration succeeded.
    """
    study, located = read_study(order.path)
    folder = StudyFolder(order.output or Path(study.output or study.name))
    folder.directory.mkdir(parents=True, exist_ok=True)
    with folder.locked():
        cells = _cells(study, located, folder.directory, order.limit)
        folder.begin(_meaning(cells))
        trials = folder.finished()
        wanted = [key for cell in cells for key in cell.keys]
        before = sum(key in trials for key in wanted)
        on_progress(before, len(wanted))
        missing = _batches(cells, trials)
        workers = min(order.workers or study.workers or os.cpu_count() or 1, max(1, len(missing)))
        done = before
        for batch in run_in_processes(run_trials, missing, workers) if missing else ():
            folder.append(batch)
            trials.update({trial.key: trial for trial in batch})
            done += len(batch)
            on_progress(done, len(wanted))
        folder.sort(trials)
    collected = [_collect(cell, trials) for cell in cells]
    if not any(t.error.size for t in collected):
        reasons = [reason for t in collected for reason in t.failed]
        raise DataError(
            "no calibration gave a result"
            + (f", the first because: {reasons[0]}" if reasons else ""),
            where=str(folder.results),
        )
    limits = StudyLimits(
        (study.limits.coverage[0], study.limits.coverage[1]),
        study.limits.family_wise,
        study.limits.rms_over_crb,
    )
    masters = tuple(study.seeds.master)
    return StudyOutcome(folder.directory, before, summarise(study.name, masters, collected, limits))


def _cells(
    study: StudyFile, located: LocatedYaml, directory: Path, limit: int | None
) -> list[_Cell]:
    bounds = read_bounds(located.path.parent / study.crb) if study.crb is not None else None
    count = study.seeds.count if limit is None else min(limit, study.seeds.count)
    cells: list[_Cell] = []
    for i, section in enumerate(study.robots):
        subject = prepare_robot(section, directory / "robots", located, i)
        for noise in study.noise:
            keys = tuple(
                TrialKey(section.name, noise.name, master, index)
                for master in study.seeds.master
                for index in range(count)
            )
            bound = np.full(len(subject.quantities.names), np.nan)
            if bounds is not None:
                bound = bound_of(bounds, subject, noise, located.where("crb"))
            cells.append(_Cell(subject, noise, keys, bound))
    return cells


def _meaning(cells: Sequence[_Cell]) -> dict[str, object]:
    """Return everything on which the results depend, but the seeds."""
    robots: dict[str, object] = {}
    noises: dict[str, object] = {}
    for cell in cells:
        robot = cell.subject.robot
        plan = None if robot.yaml_path is None else robot.yaml_path.parent / "plan.csv"
        robots[cell.subject.name] = {
            "origin": cell.subject.origin,
            "sha256": digest_of(robot.yaml_path, robot.urdf_path, plan),
            "quantities": list(cell.subject.quantities.names),
        }
        noises[cell.noise.name] = cell.noise.model_dump()
    return {
        "format": "comcal-study-results/1",
        "comcal": version("comcal"),
        "robots": robots,
        "noise": noises,
    }


def _batches(
    cells: Sequence[_Cell], trials: Mapping[TrialKey, Trial]
) -> list[tuple[StudyRobot, NoiseSection, tuple[TrialKey, ...]]]:
    """Return the arguments of the calls that do what is missing."""
    batches: list[tuple[StudyRobot, NoiseSection, tuple[TrialKey, ...]]] = []
    for cell in cells:
        missing = [key for key in cell.keys if key not in trials]
        batches += [
            (cell.subject, cell.noise, tuple(missing[i : i + BATCH]))
            for i in range(0, len(missing), BATCH)
        ]
    return batches


def _collect(cell: _Cell, trials: Mapping[TrialKey, Trial]) -> Trials:
    names = cell.subject.quantities.names
    chosen = [trials[key] for key in cell.keys]
    good = [trial for trial in chosen if not trial.failed]
    for trial in good:
        if len(trial.error) != len(names) or max(trial.withheld, default=0) >= len(names):
            raise DataError(
                f"{len(trial.error)} results of {len(names)} quantities",
                where=f"{trial.key}",
                next_step="delete its line from results.jsonl: it is then run again",
            )
    reported = np.ones((len(good), len(names)), dtype=np.bool_)
    for row, trial in enumerate(good):
        reported[row, list(trial.withheld)] = False
    return Trials(
        kind=f"{cell.subject.name}, {cell.noise.name}",
        names=names,
        units=units(names),
        error=np.array([trial.error for trial in good]).reshape(-1, len(names)),
        sigma=np.array([trial.sigma for trial in good]).reshape(-1, len(names)),
        reported=reported,
        bound=cell.bound,
        chi2=np.array([trial.chi2 for trial in good]),
        dof=np.array([float(trial.dof) for trial in good]),
        ranks=np.array([trial.rank for trial in good], dtype=np.int_),
        failed=tuple(
            f"{trial.key.robot}, {trial.key.noise}, seed {trial.key.master}, number "
            f"{trial.key.index}: {trial.failed}"
            for trial in chosen
            if trial.failed
        ),
    )
