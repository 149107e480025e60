# SPDX-License-Identifier: Apache-2.0
"""Readings taken too early, or too late: they are led along their own slopes.

Where the table says how fast a reading changed within its window (``slope.<column>``), a robot that
comes to rest like exp(-t / time) ends at reading + time * slope; and a sensor that is late by time
reads now what was true then, so that reading + time * slope is true now. Channels without slope
stay as they are; without any, both effects change nothing.

To first order only: an oscillation is neither of the two. Nor does a window of 0.2 s say much about
slopes: white noise of its samples makes their standard error sqrt(12) / 0.2 s = 17 standard errors
of the mean per second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comcal.effects.effect import Effect, Stage, State
from comcal.effects.readings import raw_sign, with_wrench
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS
from comcal.robot.model import Robot
from comcal.robot.tree import Array


def _slopes(table: PoseTable, columns: Sequence[str]) -> Array:
    """Return the slopes of some columns per second, shape (N, k); zero where there is none."""
    still = np.zeros(len(table))
    return np.column_stack(
        [np.nan_to_num(table.motion.get(f"slope.{name}", still)) for name in columns]
    )


def _led(robot: Robot, table: PoseTable, sensor: str, time: float) -> PoseTable:
    sign = raw_sign(robot, sensor) if sensor in robot.sensors else 1.0
    slope = sign * _slopes(table, [f"ft.{sensor}.{channel}" for channel in CHANNELS])
    return with_wrench(table, sensor, table.wrench[sensor] + time * slope)


def _settled(assumed: Assumed, table: PoseTable, change: Change) -> State:
    if not any(name.startswith("slope.") for name in table.motion):
        return assumed, table
    time, joints = change.number("time"), assumed.robot.tree.joint_names
    for sensor in table.wrench:
        table = _led(assumed.robot, table, sensor, time)
    q, torque, current = (
        time * _slopes(table, [f"{kind}.{joint}" for joint in joints]) for kind in ("q", "tau", "i")
    )
    imu = time * _slopes(table, [f"imu.{axis}" for axis in IMU_CHANNELS])
    return assumed, replace(
        table,
        q=table.q + q,
        torque=table.torque + torque,
        current=table.current + current,
        imu=table.imu + imu,
    )


def _on_time(assumed: Assumed, table: PoseTable, change: Change) -> State:
    return assumed, _led(assumed.robot, table, change.target, change.number("time"))


NOT_SETTLED = Effect(
    name="not_settled",
    correct=_settled,
    stage=Stage.TIME,
    fault={"time": 0.75},
    signature="every row in proportion to the slopes within the windows",
    separated_by="the same pose held for longer",
    remedy="wait longer before reading, or hold the robot stiffer",
)
TIMING_SKEW = Effect(
    name="timing_skew",
    correct=_on_time,
    stage=Stage.TIME,
    fault={"time": 0.1},
    family={"time": "timing_skew"},
    signature="the rows of one sensor in proportion to its slopes",
    separated_by="poses read in motion, both ways; at rest nothing shows it",
    remedy="correct the sensor's time stamps, or wait until the robot is still",
)
EFFECTS = (NOT_SETTLED, TIMING_SKEW)
