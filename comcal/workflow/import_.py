# SPDX-License-Identifier: Apache-2.0
"""``comcal import``: a logger's CSV in, a session folder out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from comcal.measure.importer import import_csv
from comcal.measure.poses_csv import read_poses
from comcal.robot.description import load_robot
from comcal.robot.tree import JointType


@dataclass(frozen=True)
class ImportOutcome:
    """A session that was made, and what is worth knowing of it before it is solved.

    Parameters
    ----------
    directory, poses_csv : Path
    robot : str
        Name of the robot.
    poses : int
    slides : tuple of str
        Prismatic joints, whose ranges are lengths.
    ranges : mapping from joint name to float
        How far each joint moved between all poses [rad] or [m].
    notes : tuple of str
        What was assumed, ignored or left out.
    quasi_static : bool
    """

    directory: Path
    poses_csv: Path
    robot: str
    poses: int
    slides: tuple[str, ...]
    ranges: dict[str, float]
    notes: tuple[str, ...]
    quasi_static: bool


def import_log(
    file: Path,
    map_path: Path,
    directory: Path,
    *,
    quasi_static: bool,
    between: tuple[float, float] | None = None,
) -> ImportOutcome:
    """Make a session of a log, as its map says.

    Parameters
    ----------
    file : Path
    map_path : Path
    directory : Path
        The session folder to make.
    quasi_static : bool
        Choose the slowest windows of a continuous motion.
    between : (start, end), optional
        Part of the log that is used [s]; the end is not in it.

    Raises
    ------
    UsageError, DataError
        As :func:`comcal.measure.importer.import_csv`; nothing is left behind then.
    """
    imported = import_csv(file, map_path, directory, quasi_static=quasi_static, between=between)
    session = imported.session
    robot = load_robot(session.robot_yaml)
    q = read_poses(session.poses_csv, robot).q
    names = robot.tree.joint_names
    return ImportOutcome(
        directory=directory,
        poses_csv=session.poses_csv,
        robot=robot.name,
        poses=imported.poses,
        slides=tuple(j.name for j in robot.tree.joints if j.kind is JointType.PRISMATIC),
        ranges={name: float(x) for name, x in zip(names, np.ptp(q, axis=0), strict=True)},
        notes=imported.notes,
        quasi_static=quasi_static,
    )


def import_as_json(outcome: ImportOutcome) -> dict[str, object]:
    """Return the outcome as plain data, for ``--json``; SI.

    Parameters
    ----------
    outcome : ImportOutcome
    """
    return {
        "format": "comcal-import/1",
        "session": str(outcome.directory),
        "poses_csv": str(outcome.poses_csv),
        "robot": outcome.robot,
        "poses": outcome.poses,
        "quasi_static": outcome.quasi_static,
        "joint_ranges": outcome.ranges,
        "notes": list(outcome.notes),
    }
