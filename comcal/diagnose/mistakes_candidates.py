# SPDX-License-Identifier: Apache-2.0
"""Every mistake of wiring and configuration that the readings of a robot could hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np

from comcal.effects.mistakes import measured_channels
from comcal.measure.table import PoseTable
from comcal.robot.changes import IMU, Change, Value
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS
from comcal.robot.mirror import mirrored_joints
from comcal.robot.model import Robot
from comcal.robot.tree import JointType

FORCES, MOMENTS = CHANNELS[:3], CHANNELS[3:]
GRAVITY = 9.80665
"""Of a kgf and of an acceleration in g [m/s^2]."""
POUND = 4.4482216152605
"""Force of a pound [N]."""
INCH, FOOT = 0.0254, 0.3048
"""[m]"""
FORCE_UNITS: Mapping[str, float] = {"kgf": 1.0 / GRAVITY, "lbf": 1.0 / POUND, "mN": 1e3}
"""Reading over true force."""
MOMENT_UNITS: Mapping[str, float] = {
    "N mm": 1e3,
    "N cm": 1e2,
    "kgf m": 1.0 / GRAVITY,
    "kgf cm": 1e2 / GRAVITY,
    "lbf ft": 1.0 / (POUND * FOOT),
    "lbf in": 1.0 / (POUND * INCH),
}
"""Forces in lbf and moments in lbf in are two mistakes, found one after the other."""
WRENCH_UNITS: Mapping[str, float] = {
    "kgf, kgf m": 1.0 / GRAVITY,
    "lbf, lbf m": 1.0 / POUND,
    "mN, N mm": 1e3,
}
"""One factor for all six channels: of the amplifier, or of units that agree in it."""
DEGREES, MILLI = 180.0 / np.pi, 1e3


def mistakes(robot: Robot, table: PoseTable) -> tuple[Change, ...]:
    """Return every mistake worth trying, those that say more first.

    Parameters
    ----------
    robot : Robot
    table : PoseTable
        Only what it has readings of is tried.

    Returns
    -------
    tuple of Change
        Where two of them come to the same (an axis of an IMU turned round, the sign of its
        channel), both are there.
    """
    sensors = [name for name in robot.sensors if name in table.wrench]
    found = [Change("left_right_swap", a, {"other": (b,)}) for a, b in combinations(sensors, 2)]
    for sensor in sensors:
        found += _of_sensor(sensor)
    for joint in robot.tree.joint_names:
        found += _of_joint(robot, table, joint)
    mirrored = mirrored_joints(robot)
    for left, right in mirrored:
        found += _of_pair(robot, table, left, right)
    for pair in combinations(robot.tree.joint_names, 2):
        if pair not in mirrored and pair[::-1] not in mirrored:
            found += _of_any_pair(robot, table, *pair)
    if robot.imu_link is not None and np.isfinite(table.imu).any():
        found += _of_imu()
    return tuple(found)


def _change(effect: str, target: str, channels: tuple[str, ...] = (), **more: Value) -> Change:
    named = {"channels": channels} if channels else {}
    return Change(effect, target, {**named, **more})


def _of_sensor(sensor: str) -> Iterator[Change]:
    yield _change("sign_flip", sensor, CHANNELS)
    yield _change("sign_flip", sensor, FORCES)
    yield _change("sign_flip", sensor, MOMENTS)
    for axis in "xyz":
        yield _change("frame_handedness", sensor, axis=(axis,))
    for channels, units in ((FORCES, FORCE_UNITS), (MOMENTS, MOMENT_UNITS)):
        for factor in units.values():
            yield _change("unit_error", sensor, channels, factor=factor)
    for factor in WRENCH_UNITS.values():
        yield _change("unit_error", sensor, CHANNELS, factor=factor)
    for pair in combinations(CHANNELS, 2):
        yield _change("channel_swap", sensor, pair)
    for channel in CHANNELS:
        yield _change("sign_flip", sensor, (channel,))


def _of_joint(robot: Robot, table: PoseTable, joint: str) -> Iterator[Change]:
    prismatic = robot.tree.joints[robot.tree.joint_index[joint]].kind is JointType.PRISMATIC
    for channel in measured_channels(robot, table, joint):
        yield _change("sign_flip", joint, (channel,))
        if channel == "q":
            yield _change("unit_error", joint, ("q",), factor=MILLI if prismatic else DEGREES)
        elif channel == "i":
            yield _change("unit_error", joint, ("i",), factor=MILLI)


def _of_pair(robot: Robot, table: PoseTable, left: str, right: str) -> Iterator[Change]:
    channels = [
        c
        for c in measured_channels(robot, table, left)
        if c in measured_channels(robot, table, right)
    ]
    yield _change("left_right_swap", left, other=(right,))
    if len(channels) > 1:
        for channel in channels:
            yield _change("left_right_swap", left, (channel,), other=(right,))


def _of_any_pair(robot: Robot, table: PoseTable, one: str, other: str) -> Iterator[Change]:
    for channel in measured_channels(robot, table, one):
        if channel in measured_channels(robot, table, other):
            yield _change("channel_swap", one, (channel,), other=(other,))


def _of_imu() -> Iterator[Change]:
    yield _change("sign_flip", IMU, IMU_CHANNELS)
    for axis in "xyz":
        yield _change("frame_handedness", IMU, axis=(axis,))
    for pair in combinations(IMU_CHANNELS, 2):
        yield _change("channel_swap", IMU, pair)
    for channel in IMU_CHANNELS:
        yield _change("sign_flip", IMU, (channel,))
    yield _change("unit_error", IMU, IMU_CHANNELS, factor=1.0 / GRAVITY)
