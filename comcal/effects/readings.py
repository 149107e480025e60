# SPDX-License-Identifier: Apache-2.0
"""Replace one sensor's or joint's readings in a pose table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.measure.table import PoseTable
from comcal.robot.changes import ALL, Change
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array


def with_wrench(table: PoseTable, sensor: str, wrench: Array) -> PoseTable:
    """Return *table* with other readings of a force/torque sensor, shape (N, 6)."""
    return replace(table, wrench={**table.wrench, sensor: wrench})


def raw_sign(robot: Robot, sensor: str) -> float:
    """Return the sign between a sensor's own reading and the table's wrench (ground on robot).

    A plate feels what the ground does to the feet: its sign is 1.
    """
    known = robot.sensors.get(sensor)
    return 1.0 if known is None or known.sense is Sense.ON_ROBOT else -1.0


def joints_of(robot: Robot, change: Change) -> Array:
    """Return 1 for every independent joint that a change is about, else 0, shape (n_joints,)."""
    names = robot.tree.joint_names
    if change.target == ALL:
        return np.ones(len(names))
    return np.array([float(name == change.target) for name in names])


def with_angles(table: PoseTable, more: Array) -> PoseTable:
    """Return *table* with joint positions that are larger by *more*, shape (N, n_joints)."""
    return replace(table, q=table.q + more)


def arrivals(table: PoseTable) -> Array:
    """Return from which side every joint came to where it is, shape (N, n_joints).

    +1: q was increasing, -1: decreasing; NaN where that is unknown. A joint that was not moved
    (approach 0) is where its last move brought it, in the order of the rows.
    """
    found = table.approach.copy()
    for i in range(1, len(found)):
        found[i] = np.where(found[i] == 0.0, found[i - 1], found[i])
    return np.where(found == 0.0, np.nan, found)
