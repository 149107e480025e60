# SPDX-License-Identifier: Apache-2.0
"""``comcal verify``: does a given URDF predict measured poses? Nothing is fitted."""

from __future__ import annotations

from pathlib import Path

from comcal.errors import RankError, UrdfError, UsageError
from comcal.identify.calibration import Check, Verdict
from comcal.identify.model_error import model_error
from comcal.measure.files import sha256_of
from comcal.measure.plausibility import check_plausible
from comcal.report.verify import Verification
from comcal.robot.description import load_robot
from comcal.robot.tree_differences import placement_differences, structure_differences
from comcal.workflow.calibrate import load_session
from comcal.workflow.known_model import KnownModel, model_notes


def verify_model(directory: Path, urdf: Path, model: KnownModel | None = None) -> Verification:
    """Predict the standing poses of a session with another URDF.

    The error of a pose is that of :mod:`comcal.identify.held_out`: the distance of the predicted
    CoM of what the sensors carry from the measured line of gravity; its height along that line is
    not measured. The limits are those of the session's robot.yaml, judged as ``solve`` judges them.

    Parameters
    ----------
    directory : Path
        Of the session; its robot.yaml says where the sensors are, and what hangs below their cuts
        where it states that.
    urdf : Path
        The model to be judged.
    model : KnownModel, optional
        Known changes that the URDF does not contain, such as errors of the readings: what export
        writes with ``--rest``. The session's own URDF is judged without them.

    Raises
    ------
    UrdfError
        If the URDF cannot be read, or is of another mechanism than the session's.
    RankError
        If the robot stands in no pose.
    UsageError, ConfigError, DataError
        As of :func:`~comcal.workflow.calibrate.load_session`.
    """
    session, nominal, table = load_session(directory, doubtful=model is not None)
    if not nominal.tree.geometry_known:
        raise UsageError(
            "this session is of a chain without URDF, which no URDF can be compared with",
            where=str(session.robot_yaml),
        )
    robot = load_robot(session.robot_yaml, urdf=urdf)
    differences = structure_differences(nominal.tree, robot.tree)
    if differences:
        raise UrdfError(
            f"is not the robot of this session: {'; '.join(differences)}",
            where=str(urdf),
            next_step="give a URDF with the same links and joints",
        )
    notes = list(table.notes)
    readings = table
    if model is not None:
        extended = model.of(robot, table)
        check_plausible(extended.table, extended.robot)
        notes = [*model_notes(model, extended), *notes]
        robot, readings = extended.robot, extended.table
    error = model_error(robot, readings)
    if not error.poses:
        raise RankError(
            "no pose in which a foot with a sensor stands, so there is nothing to predict",
            where=str(session.poses_csv),
            next_step="record poses with support 'double' or one foot",
        )
    limits = robot.limits
    checks: list[Check] = []
    if limits.com_error is not None:
        name = "CoM error, upper 95 %"
        checks.append(Check(name, error.com_upper, limits.com_error, "m"))
    if limits.mass_error is not None:
        off = abs(error.mass - robot.tree.total_mass)
        checks.append(Check("mass against the URDF", off, limits.mass_error, "kg"))
    verdict = Verdict.NO_LIMITS
    if checks:
        verdict = Verdict.PASSED if all(check.passed for check in checks) else Verdict.FAILED
    moved = placement_differences(nominal.tree, robot.tree)
    if moved:
        notes.append(f"joints placed otherwise than in the session's URDF: {', '.join(moved)}")
    return Verification(
        robot=robot.name,
        urdf=urdf,
        urdf_sha256=sha256_of(urdf),
        session=str(session.metadata.get("id", "")),
        error=error,
        session_error=model_error(nominal, table),
        urdf_mass=robot.tree.total_mass,
        checks=tuple(checks),
        verdict=verdict,
        notes=tuple(notes),
    )
