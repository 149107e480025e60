# SPDX-License-Identifier: Apache-2.0
"""Torques that joints must hold, given the measured loads of the feet."""

from __future__ import annotations

import numpy as np

from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import placed
from comcal.predict.remembered import remembered
from comcal.robot.tree import Array
from comcal.statics.moves import moves_of
from comcal.statics.torque_rows import joint_torques, readable_joints


@remembered
def held_torques(assumed: Assumed, table: PoseTable) -> Array:
    """Return the torque of parent on child about (along) +axis, shape (N, n_joints) [N m], [N].

    NaN where statics does not tell, or a reading is missing. A hanging robot is taken to be held at
    its root link, as the support ``none`` says.
    """
    robot = assumed.robot
    held = np.full(table.q.shape, np.nan)
    h = robot.tree.masses[:, None] * robot.tree.coms
    for support in sorted(set(table.support)):
        index = np.flatnonzero([s == support for s in table.support])
        balance, carrier, _ = placed(assumed, table.select(index), support)
        told = carrier.support == NONE or readable_joints(robot, carrier)
        joints = np.flatnonzero(np.broadcast_to(told, table.q.shape[1]))
        held[np.ix_(index, joints)] = joint_torques(balance, moves_of(balance), h)[:, joints]
    return held
