# SPDX-License-Identifier: Apache-2.0
"""From still windows straight to a pose table, without a file in between.

The same means, standard errors and variances as writing the windows to ``poses.csv`` and reading
them back; for simulations by the thousand.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.measure.average import WindowMean, average
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block
from comcal.measure.table import PoseTable
from comcal.measure.uncertainty import variances
from comcal.measure.variance import assemble_covariance
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array

FORCE, MOMENT = slice(0, 3), slice(3, 6)


def tabulate(
    robot: Robot, poses: Sequence[PlannedPose], windows: Sequence[Block], name: str
) -> PoseTable:
    """Average the still window of every pose.

    Parameters
    ----------
    robot : Robot
        Its ``noise`` states what the windows cannot show.
    poses : sequence of PlannedPose
        Only ids, supports and shapes are taken from the plan, never its angles.
    windows : sequence of Block
        One for each pose; joint angles and wrenches are used.
    name : str
        Of the source, for messages.

    Returns
    -------
    PoseTable
        Without torques, currents and IMU.

    Raises
    ------
    DataError
        If the windows' covariances are impossible.
    """
    n, n_joints = len(poses), len(robot.tree.joint_names)
    q, q_error = _stack([average(w.t, w.q) for w in windows])
    wrench: dict[str, Array] = {}
    cov: dict[str, Array] = {}
    for sensor in windows[0].wrenches:
        means = [average(w.t, w.wrenches[sensor]) for w in windows]
        value, error = _stack(means)
        plain = sensor not in robot.sensors or robot.sensors[sensor].sense is Sense.ON_ROBOT
        wrench[sensor] = value if plain else -value
        cov[sensor] = _covariance(robot, value, error, f"{name} (sensor {sensor})")
    return PoseTable(
        pose=tuple(pose.pose for pose in poses),
        support=tuple(pose.support for pose in poses),
        q=q,
        q_cov=variances(q, q_error, "encoder", robot.noise).total,
        wrench=wrench,
        wrench_cov=cov,
        torque=np.full((n, n_joints), np.nan),
        torque_var=np.full((n, n_joints), np.nan),
        current=np.full((n, n_joints), np.nan),
        current_var=np.full((n, n_joints), np.nan),
        com=np.full((n, 3), np.nan),
        com_var=np.full((n, 3), np.nan),
        imu=np.full((n, 3), np.nan),
        configuration=tuple(pose.configuration for pose in poses),
        tilt=np.array([np.nan if p.tilt is None else p.tilt for p in poses]),
    )


def _stack(means: Sequence[WindowMean]) -> tuple[Array, Array]:
    return np.array([m.mean for m in means]), np.array([m.standard_error for m in means])


def _covariance(robot: Robot, value: Array, error: Array, where: str) -> Array:
    """Return the covariance of the means of one sensor, shape (N, 6, 6)."""
    force = variances(value[:, FORCE], error[:, FORCE], "ft_force", robot.noise)
    moment = variances(value[:, MOMENT], error[:, MOMENT], "ft_moment", robot.noise)
    window = np.full((len(value), 6, 6), np.nan)
    channels = np.arange(6)
    window[:, channels, channels] = error**2
    cov = assemble_covariance(
        np.concatenate([force.window, moment.window], axis=1),
        window,
        np.concatenate([force.own, moment.own], axis=1),
        where,
    )
    cov[:, channels, channels] += np.repeat([force.revisit, moment.revisit], 3)
    return cov
