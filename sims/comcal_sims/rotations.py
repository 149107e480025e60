# SPDX-License-Identifier: Apache-2.0
"""Rotation matrices in the parametrisations that physics engines read."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import rotation_about
from comcal.robot.tree import Array

_GIMBAL = 1e-9


def floor_rotation(roll: float, pitch: float) -> Array:
    """Return ``R_world_P = Ry(pitch) Rx(roll)`` of a sloping floor, shape (3, 3).

    Positive *pitch* [rad] is toes down; positive *roll* [rad] lifts the left side.
    """
    x_axis, y_axis, _ = np.eye(3)
    return rotation_about(y_axis, pitch) @ rotation_about(x_axis, roll)


def rpy_from_rotation(R: npt.ArrayLike) -> Array:
    """Return URDF's fixed-axis roll, pitch, yaw of a rotation, shape (3,) [rad].

    Inverse of :func:`comcal.robot.frames.rotation_from_rpy`. At a pitch of a quarter turn only the
    sum or difference of roll and yaw is determined: roll is zero then.
    """
    R = np.asarray(R, dtype=np.float64)
    level = np.hypot(R[0, 0], R[1, 0])
    pitch = np.arctan2(-R[2, 0], level)
    if level < _GIMBAL:
        return np.array([0.0, pitch, np.arctan2(-R[0, 1], R[1, 1])])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def quaternion_wxyz(R: npt.ArrayLike) -> Array:
    """Return the unit quaternion of a rotation, scalar first, with w >= 0, shape (4,).

    Notes
    -----
    The columns of the symmetric matrix below are multiples of the quaternion; the longest one is
    the best conditioned, whatever the angle.
    """
    R = np.asarray(R, dtype=np.float64)
    xx, yy, zz = np.diag(R)
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    multiples = np.array(
        [
            [1 + xx + yy + zz, x, y, z],
            [x, 1 + xx - yy - zz, xy, xz],
            [y, xy, 1 - xx + yy - zz, yz],
            [z, xz, yz, 1 - xx - yy + zz],
        ]
    )
    q = multiples[:, np.argmax(np.diag(multiples))]
    q = q / np.linalg.norm(q)
    return -q if q[0] < 0 else q


def quaternion_xyzw(R: npt.ArrayLike) -> Array:
    """Return the unit quaternion of a rotation, scalar last, shape (4,)."""
    return np.roll(quaternion_wxyz(R), -1)
