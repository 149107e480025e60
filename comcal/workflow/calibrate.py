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

from comcal.effects.extend import Extended
from comcal.errors import UsageError
from comcal.identify.calibration import Calibration, Method, calibrate
from comcal.identify.consistent import consistent_fit
from comcal.identify.prior import with_prior
from comcal.identify.scope import Scope
from comcal.measure.plausibility import check_plausible
from comcal.measure.session import Session, open_session
from comcal.measure.session_poses import session_poses, unjudged_poses
from comcal.measure.table import PoseTable
from comcal.report.calibration_json import calibration_json
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.known_model import KnownModel, model_json, model_notes

MODEL = "the model"
"""What masses and CoMs are compared with where a session is solved with a model."""


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


def load_session(
    directory: Path, drop: Sequence[int] = (), *, doubtful: bool = False
) -> tuple[Session, Robot, PoseTable]:
    """Read a session folder: its frozen robot and its plausible poses.

    Parameters
    ----------
    directory : Path
    drop : sequence of int
        Pose ids to leave out.
    doubtful : bool
        Let poses that cannot be right pass with a note.

    Raises
    ------
    UsageError
        If the folder, robot.yaml or URDF is wrong, or a pose to drop is not there.
    DataError
        If the poses cannot be right (units, signs, balance, not still, not finite).
    """
    session = open_session(directory)
    robot = load_robot(session.robot_yaml)
    table = session_poses(session, robot, doubtful=doubtful)
    return session, robot, without_poses(table, drop, session)


def without_poses(table: PoseTable, drop: Sequence[int], session: Session) -> PoseTable:
    """Leave poses out of a table by their ids.

    Raises
    ------
    UsageError
        If one is not there.
    """
    _refuse_absent(table, drop, "drop", session)
    return table.select(np.array([pose not in drop for pose in table.pose], dtype=np.bool_))


@dataclass(frozen=True)
class ExtendedSession:
    """A session as a model understands it.

    Parameters
    ----------
    nominal : Robot
        As in the session's URDF.
    raw : PoseTable
        The readings as they stand.
    extended : Extended
        Robot and readings, all poses.
    """

    session: Session
    nominal: Robot
    raw: PoseTable
    extended: Extended


def load_extended(directory: Path, model: KnownModel) -> ExtendedSession:
    """Read a session folder, and correct robot and readings by a model.

    Whether the readings can be true is judged as the model understands them: a wrong unit that it
    knows of is none any more.

    Raises
    ------
    UsageError, ConfigError, DataError
        As of :func:`load_session` and of :meth:`KnownModel.of`.
    """
    session = open_session(directory)
    nominal = load_robot(session.robot_yaml)
    if not nominal.tree.geometry_known:
        raise UsageError(
            "this session is of a chain without URDF, which no effect can be applied to",
            where=str(session.robot_yaml),
            next_step="leave out --model",
        )
    raw = unjudged_poses(session, nominal)
    extended = model.of(nominal, raw)
    check_plausible(extended.table, extended.robot)
    return ExtendedSession(session, nominal, raw, extended)


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
    model: KnownModel | None = None,
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
    model : KnownModel, optional
        Known changes, by which robot and readings are corrected first.

    Raises
    ------
    UsageError, DataError
        As of :func:`load_session` and of :func:`~comcal.identify.calibration.calibrate`; nothing is
        written then.
    MissingExtraError
        If the convex solver is needed and not installed.
    """
    if model is None:
        given = None
        session, robot, table = load_session(directory, drop)
    else:
        given = load_extended(directory, model)
        session, robot, table = given.session, given.extended.robot, given.extended.table
        table = replace(table, notes=(*model_notes(model, given.extended), *table.notes))
        table = without_poses(table, drop, session)
    left_out = None
    if held_out:
        _refuse_absent(table, held_out, "hold out", session)
        is_left_out = np.array([pose in held_out for pose in table.pose], dtype=np.bool_)
        table, left_out = table.select(~is_left_out), table.select(is_left_out)
    calibration = calibrate(robot, table, method, scope or Scope(torques=True), left_out)
    if strength is not None or consistent:
        calibration = _with_assumptions(calibration, strength, consistent=consistent)
    if model is not None and given is not None:
        calibration = _against_model(calibration)
        result = calibration_json(calibration, input_hashes(session, robot))
        result["model"] = model_json(model, given.extended)
        if result["mass"] is not None:
            masses = {"urdf": given.nominal.tree.total_mass, "model": robot.tree.total_mass}
            result["mass"] |= masses
    else:
        result = calibration_json(calibration, input_hashes(session, robot))
    return Solved(session, calibration, write_result(session, result))


def _against_model(calibration: Calibration) -> Calibration:
    """Say that masses are judged against the model instead of the URDF."""
    checks = tuple(
        replace(check, name=check.name.replace("the URDF", MODEL)) for check in calibration.checks
    )
    return replace(calibration, checks=checks, reference=MODEL)


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
