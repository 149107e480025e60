# SPDX-License-Identifier: Apache-2.0
"""From the samples of a log to the rows of ``poses.csv``: one row per pose."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from comcal.errors import DataError
from comcal.measure.average import average
from comcal.measure.columns import Family, known_columns
from comcal.measure.logger_table import LoggerTable, common_word, complete, increasing_time
from comcal.measure.map_file import ImportMap
from comcal.robot.model import Robot

AVERAGED = (
    Family.JOINT,
    Family.CURRENT,
    Family.TORQUE,
    Family.WRENCH,
    Family.COM,
    Family.COP,
    Family.IMU,
    Family.TEMPERATURE,
)
"""Families that are averaged over a window, with standard errors."""
WITH_MOTION = (Family.JOINT, Family.WRENCH)
"""Families whose drift and deviation tell whether the robot was still."""
FEWEST_SAMPLES = 4
"""A window needs more to have a standard error."""


@dataclass(frozen=True)
class LogPose:
    """One row to be written.

    Parameters
    ----------
    line : int
        First line of the log that it was made of, for messages.
    cells : dict from column of ``poses.csv`` to word, number or None
    """

    line: int
    cells: dict[str, object]


def log_poses(log: LoggerTable, robot: Robot, plan: ImportMap) -> list[LogPose]:
    """Return the poses that a map declares: windows, numbered rows, or every row.

    Parameters
    ----------
    log : LoggerTable
    robot : Robot
    plan : ImportMap

    Raises
    ------
    DataError
        If a window is too short, a number comes back, a word changes within a pose, or a cell that
        is averaged is empty.
    """
    if plan.windows is None and not plan.pose_ids:
        return _plain(log)
    return [averaged(log, robot, pose, part) for pose, part in _parts(log, plan)]


def _plain(log: LoggerTable) -> list[LogPose]:
    """Return every row of the log as a pose."""
    ids = log.pose if log.pose is not None else tuple(range(1, len(log) + 1))
    poses: list[LogPose] = []
    for i, pose in enumerate(ids):
        if pose < 0:
            raise DataError(
                "the number of the pose is empty or negative",
                where=log.where(i),
                next_step="number the poses, or leave `pose` out of the map",
            )
        row: dict[str, object] = {"pose": pose}
        row |= {name: words[i] for name, words in log.words.items()}
        row |= {name: float(values[i]) for name, values in log.numbers.items()}
        poses.append(LogPose(log.file.rows[i].line, row))
    return poses


def _parts(log: LoggerTable, plan: ImportMap) -> Iterator[tuple[int, range]]:
    """Yield the pose number and the rows of each still window."""
    if plan.windows is not None:
        t = increasing_time(log)
        for k, (start, end) in enumerate(plan.windows, start=1):
            a, b = (int(x) for x in np.searchsorted(t, [start, end]))
            where = plan.located.where("windows", k - 1)
            yield k, long_enough(range(a, b), where, f"the window {start:g} s to {end:g} s")
        return
    ids = log.pose or ()
    edges = [0, *(i for i in range(1, len(ids)) if ids[i] != ids[i - 1]), len(ids)]
    seen: set[int] = set()
    for a, b in pairwise(edges):
        if ids[a] < 0:
            continue
        if ids[a] in seen:
            raise DataError(
                f"pose {ids[a]} comes back after another one",
                where=log.where(a),
                next_step="number every visit by itself; repeats are marked by `revisit`",
            )
        seen.add(ids[a])
        yield ids[a], long_enough(range(a, b), log.where(a), f"pose {ids[a]}")
    if not seen:
        raise DataError(
            f"no row has a number in the column {plan.pose_ids}",
            where=log.file.path.name,
            next_step="number the rows that belong to a pose from 0 or 1",
        )


def long_enough(rows: range, where: str, what: str) -> range:
    """Return *rows*, or refuse them.

    Raises
    ------
    DataError
        If they are fewer than ``FEWEST_SAMPLES``.
    """
    if len(rows) < FEWEST_SAMPLES:
        raise DataError(
            f"{what} holds too few samples",
            where=where,
            measured=f"{len(rows)} samples",
            limit=f"{FEWEST_SAMPLES}",
            next_step="check the times, or log faster",
        )
    return rows


def averaged(
    log: LoggerTable, robot: Robot, pose: int, rows: range, stopped: Collection[str] = ()
) -> LogPose:
    """Return the means, standard errors and drift of one still window.

    Parameters
    ----------
    log : LoggerTable
    robot : Robot
    pose : int
        Its number.
    rows : range
        Of the log.
    stopped : collection of str
        Force sensors and plates that may have gaps: one that has any gets empty cells.

    Raises
    ------
    DataError
        If a word changes within the window.
    NotFiniteError
        If a cell that is averaged is empty.
    """
    known = known_columns(robot)
    row: dict[str, object] = {"pose": pose}
    row |= {name: common_word(log, name, rows) for name in log.words}
    has_time = "t" in log.numbers
    t = complete(log, ["t"], rows)[:, 0] if has_time else np.arange(float(len(rows)))
    effective: list[float] = []
    for names in _instruments(log, robot):
        if known[names[0]].target in stopped and _has_gap(log, names, rows):
            row |= dict.fromkeys(names)
            continue
        mean = average(t, complete(log, names, rows))
        effective.append(mean.effective_n)
        for k, name in enumerate(names):
            row[name] = float(mean.mean[k])
            row[f"se.{name}"] = _with_stated(log, name, rows, float(mean.standard_error[k]))
            if has_time and known[name].family in WITH_MOTION:
                row[f"sd.{name}"] = float(mean.sd[k])
                row[f"slope.{name}"] = float(mean.slope[k])
    others = [
        name for name in log.numbers if name not in row and known[name].family not in AVERAGED
    ]
    for name in others:
        values = log.numbers[name][list(rows)]
        known_values = values[np.isfinite(values)]
        row[name] = float(known_values.mean()) if known_values.size else None
        if name.startswith("approach.") and np.ptp(known_values) > 0.0:
            row[name] = None
    if effective:
        row["n"] = round(min(effective))
    return LogPose(log.file.rows[rows[0]].line, row)


def _has_gap(log: LoggerTable, names: list[str], rows: range) -> bool:
    return any(bool(np.isnan(log.numbers[name][list(rows)]).any()) for name in names)


def _with_stated(log: LoggerTable, name: str, rows: range, window: float) -> float:
    """Return the standard error of a window's mean together with one that the map states."""
    if f"se.{name}" not in log.numbers:
        return window
    return float(np.hypot(window, complete(log, [f"se.{name}"], rows).max()))


def _instruments(log: LoggerTable, robot: Robot) -> list[list[str]]:
    """Return the averaged columns, those of one instrument together."""
    known = known_columns(robot)
    groups: dict[tuple[Family, str], list[str]] = {}
    for name in log.numbers:
        column = known[name]
        if column.family in AVERAGED:
            one = column.target if column.family is Family.WRENCH else ""
            groups.setdefault((column.family, one), []).append(name)
    return list(groups.values())
