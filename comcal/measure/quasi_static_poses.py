# SPDX-License-Identifier: Apache-2.0
"""The slowest windows of a log as rows of ``poses.csv``, with what inertia does to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.measure.columns import CHANNELS
from comcal.measure.inertia import neglected_wrenches
from comcal.measure.log_poses import LogPose, averaged, long_enough
from comcal.measure.logger_table import LoggerTable, complete, increasing_time
from comcal.measure.map_file import ImportMap
from comcal.measure.plan import DOUBLE
from comcal.measure.quasi_static import QuasiStatic, differentiate, slowest_windows
from comcal.measure.stuck import Stuck, masked, stuck_sensors
from comcal.robot.model import Robot
from comcal.robot.tree import Array

LEFT_OUT = ("tau.", "i.", "se.tau.", "se.i.")
"""Columns on which inertia acts in a way that is not accounted for."""
MOTION = ("qd.", "qdd.", "slope.", "sd.")
"""Columns that would say what is known and accounted for: that the robot was not quite still."""


def quasi_static_poses(
    log: LoggerTable, robot: Robot, plan: ImportMap
) -> tuple[list[LogPose], tuple[str, ...]]:
    """Return the slowest windows, their standard errors widened by the neglected inertia.

    A force sensor that has stopped within a window has no reading in it; windows in which it would
    carry the robot are not taken.

    Parameters
    ----------
    log : LoggerTable
        With ``t`` and the position of every joint.
    robot : Robot
        With a URDF.
    plan : ImportMap

    Returns
    -------
    poses : list of LogPose
    notes : tuple of str

    Raises
    ------
    ConfigError
        If windows are declared, a joint is not mapped, or masses are not known.
    DataError
        If the log is too short or not regular enough to be differentiated.
    """
    if plan.windows is not None or plan.pose_ids:
        raise ConfigError(
            "quasi-static windows are chosen, so none may be declared",
            where=plan.located.where("windows" if plan.windows is not None else "pose_ids"),
            next_step="leave out --quasi-static, or `windows` and `pose_ids`",
        )
    if not robot.tree.geometry_known:
        raise ConfigError(
            "the inertia of a chain without URDF is not known",
            where=robot.name,
            next_step="give a URDF, or measure at rest and import without --quasi-static",
        )
    joints = robot.tree.joint_names
    missing = [f"q.{j}" for j in joints if f"q.{j}" not in log.numbers]
    if missing:
        raise ConfigError(
            f"column {missing[0]} is not mapped",
            where=plan.located.where("columns"),
            next_step="map the position of every joint, or give it under constants",
        )
    t = increasing_time(log)
    everything = range(len(log))
    q = complete(log, [f"q.{j}" for j in joints], everything)
    qd, qdd = _motion(log, joints, t, q, plan.quasi_static)
    support = log.words.get("support", ("",) * len(log))
    labels = tuple("\n".join(words) for words in zip(*log.words.values(), strict=True)) or support
    stuck = stuck_sensors(log, robot, t, plan.quasi_static.stuck)
    usable = ~_carried_by(stuck, robot, support)
    log = masked(log, robot, stuck)
    poses: list[LogPose] = []
    windows = slowest_windows(t, q, qd, qdd, labels, plan.quasi_static, usable)
    for k, window in enumerate(windows, start=1):
        part = range(window.start, window.stop)
        rows = long_enough(part, log.where(part[0]), "a window")
        pose = averaged(log, robot, k, rows, [one.sensor for one in stuck])
        motion = q[window], qd[window], qdd[window]
        poses.append(_with_inertia(pose, robot, support[part[0]], *motion))
    notes = [
        f"quasi-static: {len(poses)} windows of {plan.quasi_static.window:g} s; what inertia does "
        "is contained in the standard errors",
        *(one.note for one in stuck),
    ]
    dropped = sorted({n.split(".")[0] for n in log.numbers if n.startswith(LEFT_OUT)})
    if dropped:
        notes.append(f"left out, since inertia acts on them too: {', '.join(dropped)} columns")
    return poses, tuple(notes)


def _motion(
    log: LoggerTable, joints: Sequence[str], t: Array, q: Array, options: QuasiStatic
) -> tuple[Array, Array]:
    """Return velocities and accelerations, measured where mapped, else differentiated."""
    everything = range(len(log))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    names = {"qd": [f"qd.{j}" for j in joints], "qdd": [f"qdd.{j}" for j in joints]}
    given = {k: all(name in log.numbers for name in v) for k, v in names.items()}
    if not all(given.values()):
        qd, qdd = differentiate(t, q, options.smoothing)
    if given["qd"]:
        qd = complete(log, names["qd"], everything)
    if given["qdd"]:
        qdd = complete(log, names["qdd"], everything)
    return qd, qdd


def _carried_by(
    stuck: Sequence[Stuck], robot: Robot, support: Sequence[str]
) -> npt.NDArray[np.bool_]:
    """Return in which samples a sensor that has stopped carries the robot, shape (n,)."""
    found = np.zeros(len(support), dtype=np.bool_)
    for one in stuck:
        feet = {foot.name for foot in robot.feet.values() if foot.sensor == one.sensor}
        if one.sensor in robot.plates:
            feet |= set(robot.plates[one.sensor].feet)
        stands = np.array([bool(feet) and word in (DOUBLE, *feet) for word in support])
        found |= one.samples & stands
    return found


def _with_inertia(
    pose: LogPose, robot: Robot, support: str, q: Array, qd: Array, qdd: Array
) -> LogPose:
    """Add the root mean square of the neglected wrench to the standard errors of a window."""
    wrenches, cop = neglected_wrenches(robot, q, qd, qdd, support)
    extra = {
        f"ft.{name}.{c}": float(np.sqrt(np.mean(w[:, k] ** 2)))
        for name, w in wrenches.items()
        for k, c in enumerate(CHANNELS)
    }
    for k, axis in enumerate("xy"):
        shift = float(np.sqrt(np.mean(cop[:, k] ** 2)))
        extra |= {f"com.{axis}": shift, f"cop.{axis}": shift}
    kept = {n: v for n, v in pose.cells.items() if not n.startswith((*LEFT_OUT, *MOTION))}
    for name, error in extra.items():
        window = kept.get(f"se.{name}")
        if isinstance(window, float):
            kept[f"se.{name}"] = float(np.hypot(window, error))
    return LogPose(pose.line, kept)
