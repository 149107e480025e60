# SPDX-License-Identifier: Apache-2.0
"""``comcal solve``: a session folder in, a calibration and its result files out."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from comcal.errors import UsageError
from comcal.identify.calibration import Calibration, Method, calibrate
from comcal.identify.consistent import consistent_fit
from comcal.identify.prior import with_prior
from comcal.identify.scope import Scope
from comcal.measure.session import Session, open_session
from comcal.measure.session_poses import session_poses
from comcal.measure.table import PoseTable
from comcal.report.calibration_json import calibration_json
from comcal.robot.description import load_robot
from comcal.robot.model import Robot


@dataclass(frozen=True)
class Solved:
    """A calibration and where its files lie.

    Parameters
    ----------
    files : tuple of Path
        Written files, ``result.json`` first.
    """

    session: Session
    calibration: Calibration
    files: tuple[Path, ...]


def load_session(directory: Path, drop: Sequence[int] = ()) -> tuple[Session, Robot, PoseTable]:
    """Read a session folder: its frozen robot and its plausible poses.

    Parameters
    ----------
    directory : Path
    drop : sequence of int
        Pose ids to leave out.

    Raises
    ------
    UsageError
        If the folder, robot.yaml or URDF is wrong, or a pose to drop is not there.
    DataError
        If the poses cannot be right (units, signs, balance, not still, not finite).
    """
    session = open_session(directory)
    robot = load_robot(session.robot_yaml)
    table = session_poses(session, robot)
    _refuse_absent(table, drop, "drop", session)
    kept = np.array([pose not in drop for pose in table.pose], dtype=np.bool_)
    return session, robot, table.select(kept)


def _refuse_absent(table: PoseTable, poses: Sequence[int], to_do: str, session: Session) -> None:
    missing = [pose for pose in poses if pose not in table.pose]
    if missing:
        raise UsageError(
            f"there is no pose {missing[0]} to {to_do}",
            where=str(session.poses_csv),
            next_step="poses: " + ", ".join(map(str, table.pose)),
        )


def solve_session(
    directory: Path,
    method: Method = Method.BOTH,
    drop: Sequence[int] = (),
    scope: Scope | None = None,
    *,
    strength: float | None = None,
    consistent: bool = False,
    held_out: Sequence[int] = (),
) -> Solved:
    """Calibrate a session and write ``results/NNN/result.json`` and ``used.csv``.

    Parameters
    ----------
    directory : Path
    method : Method
    drop : sequence of int
        Pose ids to leave out.
    scope : Scope, optional
        What the all-data route uses and looks for; by default all readings.
    strength : float, optional
        Join the all-data route with CAD as well, at this strength.
    consistent : bool
        Look for the nearest physically possible robot as well.
    held_out : sequence of int
        Pose ids to predict and not to fit; without any, the all-data route cross-validates.

    Raises
    ------
    UsageError, DataError
        As of :func:`load_session` and of :func:`~comcal.identify.calibration.calibrate`; nothing is
        written then.
    MissingExtraError
        If the convex solver is needed and not installed.
    """
    session, robot, table = load_session(directory, drop)
    left_out = None
    if held_out:
        _refuse_absent(table, held_out, "hold out", session)
        is_left_out = np.array([pose in held_out for pose in table.pose], dtype=np.bool_)
        table, left_out = table.select(~is_left_out), table.select(is_left_out)
    calibration = calibrate(robot, table, method, scope or Scope(torques=True), left_out)
    if strength is not None or consistent:
        calibration = _with_assumptions(calibration, strength, consistent=consistent)
    result = calibration_json(calibration, input_hashes(session, robot))
    return Solved(session, calibration, write_result(session, result))


def _with_assumptions(
    calibration: Calibration, strength: float | None, *, consistent: bool
) -> Calibration:
    """Add what is assumed beside what is measured; the measured part stays as it is."""
    if calibration.solution is None:
        raise UsageError(
            "a prior and physical consistency go with the all-data route, which was not taken",
            next_step="leave out --method cramer, and record poses with a loaded sensor",
        )
    fit = calibration.solution.adjustment
    return replace(
        calibration,
        with_prior=None if strength is None else with_prior(fit, strength),
        consistent=consistent_fit(fit) if consistent else None,
    )


def input_hashes(session: Session, robot: Robot) -> dict[str, str]:
    """Return the SHA-256 of what a result of *session* is made from, by file name."""
    paths = (session.robot_yaml, session.poses_csv, robot.urdf_path)
    return {path.name: _sha256(path) for path in paths if path is not None}


def write_result(session: Session, result: Mapping[str, object]) -> tuple[Path, ...]:
    """Write ``results/NNN/result.json`` and ``used.csv``; return their paths.

    Parameters
    ----------
    session : Session
    result : mapping
        What ``result.json`` is to hold.
    """
    folder = session.new_result_folder()
    path = folder / "result.json"
    text = json.dumps(result, indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    used = folder / "used.csv"
    shutil.copyfile(session.poses_csv, used)
    session.publish_result(folder)
    return path, used


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def is_chain(directory: Path) -> bool:
    """Return whether a session's robot is a chain without URDF."""
    return not load_robot(open_session(directory).robot_yaml).tree.geometry_known
