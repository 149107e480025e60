# SPDX-License-Identifier: Apache-2.0
"""Derivatives by joint positions, by central differences over all poses and joints at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from comcal.robot.tree import Array

STEP = 1e-6
"""[rad] or [m]; errors are near 1e-10 of the value."""


def joint_slopes(value: Callable[[Array], Array], q: Array) -> Array:
    """Return d(value)/dq of N poses, shape (N, ..., n_joints).

    Parameters
    ----------
    value : callable
        Takes positions of shape (K N, n_joints), K moved copies of *q* one below the other, to
        values of shape (K N, ...).
    q : array, shape (N, n_joints)
        [rad] or [m]
    """
    n, n_joints = q.shape
    step = np.vstack([np.eye(n_joints), -np.eye(n_joints)]) * STEP
    moved = value((q[None] + step[:, None]).reshape(-1, n_joints))
    moved = moved.reshape(2, n_joints, n, *moved.shape[1:])
    return np.moveaxis((moved[0] - moved[1]) / (2 * STEP), 0, -1)
