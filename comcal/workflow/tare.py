# SPDX-License-Identifier: Apache-2.0
"""``comcal tare``: what the sensors read while nothing loads them, into the session."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from comcal.errors import UsageError
from comcal.measure.columns import near_miss
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.plan_csv import read_plan
from comcal.measure.session import Session, is_session, open_session
from comcal.measure.source import Commander
from comcal.measure.tare import Tare, still_window, store_tares, tares_of
from comcal.robot.changes import check_changes
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.workflow.session_source import SourceOrder, opened_session

TARE_POSE = -1
"""Id of the pose in which a simulated robot is tared: before the first one of any plan."""


@dataclass(frozen=True)
class TareOrder:
    """What to tare.

    Parameters
    ----------
    robot_yaml : Path
    source : SourceOrder
        With the session folder.
    sensors : tuple of str
        Empty: all that are in the air.
    standing : str
        The foot on which the robot stands; empty: it hangs.
    hanging : bool
        Whether the links below the cuts hang from their sensors.
    seconds, timeout : float
        Length of the still window, and how long to wait for it [s].
    limit : float or None
        Largest force believed to be an offset [N].
    again : bool
        Whether older tares may be replaced.
    plan : Path or None
        Where a simulated robot finds a pose to stand in; None: ``plan.csv`` beside ``robot_yaml``.
    """

    robot_yaml: Path
    source: SourceOrder
    sensors: tuple[str, ...] = ()
    standing: str = ""
    hanging: bool = True
    seconds: float = 5.0
    timeout: float = 60.0
    limit: float | None = None
    again: bool = False
    plan: Path | None = None


@dataclass(frozen=True)
class TareOutcome:
    """New tares, and those that they replaced.

    Parameters
    ----------
    session : Session
    tares : tuple of Tare
    before : dict from sensor name to (value, sigma)
    engine : str
    poses : int
        That the session has already, and which now count from the new tares.
    """

    session: Session
    tares: tuple[Tare, ...]
    before: dict[str, tuple[Array, Array]]
    engine: str
    poses: int


def tare_session(order: TareOrder) -> TareOutcome:
    """Read the unloaded sensors and store what they read.

    Parameters
    ----------
    order : TareOrder

    Raises
    ------
    UsageError
        If robot, source, sensors and session are not usable together, or a tare would be replaced.
    DataError
        If the robot is not still, or a sensor is loaded or silent.
    HardwareError
        If the source delivers nothing.
    """
    robot = load_robot(order.robot_yaml)
    check_changes(order.source.changes, robot)
    sensors = _sensors(order, robot)
    plan = _plan(order, robot)
    if is_session(order.source.directory):
        _refuse_older(order, sensors)
    with opened_session(order.source, robot, plan) as opened:
        source = opened.source
        if isinstance(source, Commander):
            source.move_to(_unloaded_pose(order, robot, plan))
        window = still_window(robot, source, sensors, order.seconds, order.timeout)
        tares = tares_of(
            window, robot, order.standing or NONE, hanging=order.hanging, limit=order.limit
        )
        before = opened.session.tares()
        store_tares(opened.session, tares, again=order.again)
        poses = len(opened.session.finished_poses())
        return TareOutcome(opened.session, tares, before, source.name, poses)


def _sensors(order: TareOrder, robot: Robot) -> tuple[str, ...]:
    """Return the sensors to tare."""
    for name in order.sensors:
        if name not in robot.sensors:
            near = near_miss(name, robot.sensors)
            raise UsageError(
                f"there is no sensor {name!r}",
                where="--sensor",
                next_step=f"did you mean {near}?"
                if near
                else f"there are: {', '.join(robot.sensors) or 'none'}",
            )
    if order.standing and order.standing not in robot.feet:
        raise UsageError(
            f"there is no foot {order.standing!r}",
            where="--standing",
            next_step=f"there are: {', '.join(robot.feet) or 'none'}",
        )
    loaded = robot.feet[order.standing].sensor if order.standing else None
    if loaded is not None and loaded in order.sensors:
        raise UsageError(
            f"foot {order.standing} stands, so its sensor is loaded",
            where=f"--sensor {loaded}",
            next_step="tare it while another foot stands, or the robot hangs",
        )
    found = order.sensors or tuple(name for name in robot.sensors if name != loaded)
    if not found:
        raise UsageError(
            "there is no sensor to tare",
            where=str(order.robot_yaml),
            next_step="describe it under `sensors` of robot.yaml",
        )
    return found


def _refuse_older(order: TareOrder, sensors: tuple[str, ...]) -> None:
    """Refuse to replace a tare before anything is read; it is looked at once more when writing."""
    session = open_session(order.source.directory)
    older = [name for name in sensors if name in session.tares()]
    if older and not order.again:
        raise UsageError(
            f"there is a tare of {', '.join(older)} already",
            where=str(session.session_yaml),
            next_step="give --again to use a new one for all poses of this session; the old one "
            "is kept in tare_history",
        )


def _plan(order: TareOrder, robot: Robot) -> tuple[PlannedPose, ...]:
    path = order.plan or order.robot_yaml.parent / "plan.csv"
    if order.plan is None and not path.is_file():
        return ()
    return read_plan(path, robot.tree.joint_names)


def _unloaded_pose(order: TareOrder, robot: Robot, plan: tuple[PlannedPose, ...]) -> PlannedPose:
    """Return where a simulated robot is tared: a planned pose of that support, or q = 0."""
    support = order.standing or NONE
    found = next((pose.q for pose in plan if pose.support == support), None)
    if found is None and order.standing:
        raise UsageError(
            f"the plan has no pose on foot {order.standing}, so a simulated robot cannot stand so",
            where="--standing",
            next_step="leave it out: then the robot hangs; or give a plan with --poses",
        )
    if found is None:
        tree = robot.tree
        joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
        found = np.array([np.clip(0.0, joint.lower, joint.upper) for joint in joints])
    return PlannedPose(TARE_POSE, found, support)
