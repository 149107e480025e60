# SPDX-License-Identifier: Apache-2.0
"""Rotations and rigid transforms as plain arrays, batched over leading axes.

``T_a_b`` maps coordinates in frame b to coordinates in frame a, so neighbours cancel:
``T_world_base @ T_base_foot``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.robot.tree import Array


def rotation_about(axis: npt.ArrayLike, angle: npt.ArrayLike) -> Array:
    """Return the rotation by *angle* about a unit *axis* (Rodrigues).

    Parameters
    ----------
    axis : array, shape (3,)
        Unit vector.
    angle : array, shape (...)
        [rad].

    Returns
    -------
    R : array, shape (..., 3, 3)

    Examples
    --------
    A quarter turn about z takes x to y:

    >>> (rotation_about([0, 0, 1], np.pi / 2) @ [1, 0, 0]).round(12).tolist()
    [0.0, 1.0, 0.0]
    """
    K = skew(axis)
    angle = np.asarray(angle, dtype=np.float64)[..., None, None]
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


def rotation_from_rpy(rpy: npt.ArrayLike) -> Array:
    """Return URDF's fixed-axis rotation ``Rz(yaw) Ry(pitch) Rx(roll)``, multiplied out.

    Parameters
    ----------
    rpy : array, shape (..., 3)
        Roll, pitch, yaw [rad].

    Returns
    -------
    R : array, shape (..., 3, 3)
    """
    angles = np.asarray(rpy, dtype=np.float64)
    (sr, sp, sy), (cr, cp, cy) = (np.moveaxis(f(angles), -1, 0) for f in (np.sin, np.cos))
    R = np.empty((*angles.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = (
        cy * cp,
        cy * sp * sr - sy * cr,
        cy * sp * cr + sy * sr,
    )
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = (
        sy * cp,
        sy * sp * sr + cy * cr,
        sy * sp * cr - cy * sr,
    )
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -sp, cp * sr, cp * cr
    return R


def transform_from(R: npt.ArrayLike, p: npt.ArrayLike) -> Array:
    """Return the 4x4 transform of rotation *R*, shape (3, 3), and origin *p*, shape (3,) [m]."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = p
    return T


def skew(v: npt.ArrayLike) -> Array:
    """Return the matrix of ``v x``, shape (..., 3, 3), for vectors of shape (..., 3)."""
    v = np.asarray(v, dtype=np.float64)
    K = np.zeros((*v.shape[:-1], 3, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    K[..., 1, 0], K[..., 2, 0], K[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return K


def cross(a: Array, b: Array) -> Array:
    """Return ``a x b`` for stacks of vectors (..., 3), which may broadcast.

    Several times faster than ``numpy.cross``, which moves axes about.
    """
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out[..., 0] = ay * bz - az * by
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx
    return out


def apply(R: Array, v: npt.ArrayLike) -> Array:
    """Return ``R v`` for stacks of rotations (..., 3, 3) and vectors (..., 3)."""
    return np.einsum("...ij,...j->...i", R, np.asarray(v, dtype=np.float64))
