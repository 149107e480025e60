# SPDX-License-Identifier: Apache-2.0
"""What the sensors of the nominal robot will read in planned poses on a level floor."""

from __future__ import annotations

import numpy as np

from comcal.measure.table import PoseTable
from comcal.plan.candidates import Pool
from comcal.robot.frames import apply
from comcal.robot.model import Noise, Robot
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at, first_moments
from comcal.statics.stance import stance_frame
from comcal.statics.support import carrier_of

LEAST_SHARE = 0.1
"""Of the weight that each of two standing feet is taken to carry at least."""


def expected_table(robot: Robot, poses: Pool) -> PoseTable:
    """Return the pose table of planned poses, without any error but with all covariances.

    Parameters
    ----------
    robot : Robot
        The nominal one; its ``noise`` says what a pose mean is worth.
    poses : Pool
        Balanced poses.
    """
    n, n_joints = poses.q.shape
    sensors = [*robot.sensors, *robot.plates]
    wrench = {name: np.full((n, 6), np.nan) for name in sensors}
    for support in sorted(set(poses.support)):
        rows = np.flatnonzero([s == support for s in poses.support])
        loaded, w = expected_wrenches(robot, support, poses.q[rows])
        for k, sensor in enumerate(loaded):
            wrench[sensor][rows] = w[:, k]
    used = {name: w for name, w in wrench.items() if np.isfinite(w).any()}
    family = [_variance(robot.noise, "ft_force"), _variance(robot.noise, "ft_moment")]
    cov = np.tile(np.diag(np.repeat(family, 3)), (n, 1, 1))
    empty = np.full((n, n_joints), np.nan)
    nowhere = np.full((n, 3), np.nan)
    return PoseTable(
        pose=tuple(range(1, n + 1)),
        support=poses.support,
        q=poses.q,
        q_cov=np.full((n, n_joints), _variance(robot.noise, "encoder")),
        wrench=used,
        wrench_cov=dict.fromkeys(used, cov),
        torque=empty,
        torque_var=empty,
        current=empty,
        current_var=empty,
        com=nowhere,
        com_var=nowhere,
        imu=nowhere,
        configuration=("",) * n,
        tilt=np.full(n, np.nan),
    )


def expected_wrenches(robot: Robot, support: str, q: Array) -> tuple[tuple[str, ...], Array]:
    """Return the loaded sensors of a support and what they read on a level floor.

    Two feet share the weight by where the CoM is between them; the sum is exact.

    Parameters
    ----------
    robot : Robot
    support : str
    q : array, shape (N, n_joints)

    Returns
    -------
    sensors : tuple of str
    w : array, shape (N, n_sensors, 6)
        Ground on robot, in and about each sensor's frame [N, N m].
    """
    carrier = carrier_of(robot, support)
    empty = balance_at(robot, carrier, q, np.zeros((len(q), len(carrier.sensors), 6)))
    up = stance_frame(robot, support, empty.placements)[0][..., 2]
    S = first_moments(empty, robot.tree.masses[:, None] * robot.tree.coms).sum(axis=1)
    mass = float(robot.tree.masses[carrier.carried].sum())
    F, M = robot.gravity * mass * up, robot.gravity * np.cross(S, up)
    R_sensor_root = np.swapaxes(empty.X[:, :, :3, :3], 2, 3)
    p = _from_skew(empty.X[:, :, 3:, :3] @ R_sensor_root)
    share = _shares(S / mass, p, up)[..., None]
    force = share * F[:, None]
    moment = share * (M - np.cross(p, force).sum(axis=1))[:, None]
    w = np.concatenate([apply(R_sensor_root, force), apply(R_sensor_root, moment)], axis=-1)
    return carrier.sensors, w


def _variance(noise: Noise, family: str) -> float:
    """Return the variance of a pose mean: of its window, and the scatter between visits."""
    return float(getattr(noise, family)) ** 2 + float(noise.revisit.get(family, 0.0)) ** 2


def _shares(com: Array, p: Array, up: Array) -> Array:
    """Return the share of the weight on each of the sensors at *p*, shape (N, n_sensors)."""
    n_sensors = p.shape[1]
    if n_sensors != 2:
        return np.full(p.shape[:2], 1.0 / n_sensors)
    across = p[:, 1] - p[:, 0]
    across = across - np.sum(across * up, axis=1, keepdims=True) * up
    along = np.sum((com - p[:, 0]) * across, axis=1) / np.sum(across**2, axis=1)
    along = np.clip(along, LEAST_SHARE, 1.0 - LEAST_SHARE)
    return np.stack([1.0 - along, along], axis=1)


def _from_skew(K: Array) -> Array:
    return np.stack([K[..., 2, 1], K[..., 0, 2], K[..., 1, 0]], axis=-1)
