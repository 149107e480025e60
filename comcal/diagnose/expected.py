# SPDX-License-Identifier: Apache-2.0
"""What sensors should have read in the poses of a table, if the model is right.

A false reading must not say how far readings may stray: what depends on the size of a load is
taken from these instead of from the measured ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.diagnose.linear import Linear
from comcal.diagnose.readings import layout_of, stacked, with_readings
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import placed
from comcal.robot.frames import apply, rotation_from_rpy
from comcal.robot.tree import Array
from comcal.statics.torque_rows import motor_torque_factors

LEVER = 0.05
"""How two feet share the load: the least forces, with moments weighed against them by this [m]."""


def expected_readings(assumed: Assumed, table: PoseTable) -> PoseTable:
    """Return the readings that leave no residual, in the poses that the encoders tell.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
        Joint positions count, and of a hanging robot which way is up; of the rest only which
        readings there are.

    Returns
    -------
    PoseTable
        Two feet share the load with the least wrenches. Torques that statics does not tell are
        zero.
    """
    table = replace(table, imu=_expected_imu(assumed, table))
    layout, silent = layout_of(table), stacked(table)
    wrench = slice(3 * layout.joints + 3, layout.size)
    silent[:, layout.joints : 3 * layout.joints] *= 0.0
    silent[:, wrench] *= 0.0
    linear = Linear(assumed, with_readings(table, silent))
    row, pose = linear.at.row, linear.at.pose
    residual, slopes = np.nan_to_num(linear.at.values), linear.slopes[:, wrench]
    scale = np.tile([1.0, 1.0, 1.0, LEVER, LEVER, LEVER], len(layout.sensors))
    told = np.zeros((len(table), slopes.shape[1]))
    in_balance = np.array([r.kind in ("equilibrium", "sensor") for r in row], np.bool_)
    for i in range(len(table)):
        mine = in_balance & (pose == i)
        told[i] = -scale * (np.linalg.pinv(slopes[mine] * scale) @ residual[mine])
    left = residual + np.einsum("nr,nr->n", slopes, told[pose])
    held = np.zeros(table.q.shape)
    joint = {name: k for k, name in enumerate(assumed.robot.tree.joint_names)}
    for value, i, r in zip(left, pose, row, strict=True):
        if r.kind == "torque":
            held[i, joint[r.of]] = -value
    silent[:, wrench] += told
    found = with_readings(table, silent)
    by_motor = held / motor_torque_factors(assumed.robot)
    return replace(found, torque=found.torque + held, current=found.current + by_motor)


def _expected_imu(assumed: Assumed, table: PoseTable) -> Array:
    """Return the specific force of standing poses, shape (N, 3) [m/s^2]; hanging as measured."""
    robot, imu = assumed.robot, table.imu.copy()
    if robot.imu_link is None:
        return imu
    R_link_imu = rotation_from_rpy([*assumed.imu_tilt, 0.0])
    for support in sorted(set(table.support) - {NONE}):
        index = np.flatnonzero([s == support for s in table.support])
        balance, _, _ = placed(assumed, table.select(index), support)
        R_root_imu = balance.placements.link(robot.imu_link)[0] @ R_link_imu
        up = apply(np.swapaxes(R_root_imu, 1, 2), balance.direction)
        # A missing reading stays missing.
        imu[index] = imu[index] * 0.0 + robot.gravity * up
    return imu
