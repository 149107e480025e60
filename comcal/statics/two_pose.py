# SPDX-License-Identifier: Apache-2.0
r"""Total CoM from one shape measured at two tilts, or on two slopes.

Derived from (14)-(17) of Muscolo 2017 for any ankle position (A, U) and any number of poses k of
the shape, tilted by :math:`\theta_k` against the reference posture:

.. math::

   m_w [l_w (s_k - \beta_k c_k) + r_w (c_k + \beta_k s_k)]
     = m_2 \alpha_k - m_u r_u - m_w A + \beta_k (m_u l_u + m_w U)

together with the same for Y. With :math:`\beta_k = \tan\varphi_k` the determinant for two poses
is :math:`\sin((\theta_2 - \varphi_2) - (\theta_1 - \varphi_1)) / (\cos\varphi_1 \cos\varphi_2)`:
it does not matter whether the robot is tilted or the floor. With equal tilts the CAD values drop
out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array

MIN_TILT = np.deg2rad(3.0)
"""Smallest spread of theta - phi that is solved [rad]; Z is then 27 times worse than X."""


@dataclass(frozen=True)
class FootSide:
    """What the two-pose formula takes from CAD, in P, for each of K poses of a shape.

    Nothing of it changes from pose to pose unless the sensors are above the ankles: then P tilts
    with them, and the ankles move in P.

    Parameters
    ----------
    mass : array, shape (...)
        m_u: carried mass that does not tilt [kg].
    r, l : array, shape (..., K)
        Its CoM: x and z in P [m].
    ankle_x, ankle_z : array, shape (..., K)
        A and U: the tilt axis in P [m].
    """

    mass: Array
    r: Array
    l: Array  # noqa: E741 - the paper's letter
    ankle_x: Array
    ankle_z: Array


def total_com(coefficients: Array, mass: Array, tilts: Array, foot: FootSide) -> Array:
    """Return the carried CoM in the reference posture (tilt 0), in P, shape (..., 3) [m].

    Parameters
    ----------
    coefficients : array, shape (..., K, 4)
        alpha, beta, gamma, delta of each pose of the shape.
    mass : array, shape (...)
        m_2: what the sensors carry [kg].
    tilts : array, shape (..., K)
        Relative to the reference posture [rad], positive about +y.
    foot : FootSide

    Notes
    -----
    The least-squares solution when more than two poses are given; *not* determined when
    theta - phi is the same in all of them (see :func:`spread`).
    """
    alpha, beta, gamma, delta = np.moveaxis(coefficients, -1, 0)
    s, c = np.sin(tilts), np.cos(tilts)
    m_u, m_2 = foot.mass[..., None], mass[..., None]
    m_w = m_2 - m_u
    x_known = m_u * foot.r + m_w * foot.ankle_x
    z_known = m_u * foot.l + m_w * foot.ankle_z
    zero = np.zeros_like(s)
    # Unknowns: m_w l_w / m_2, m_w r_w / m_2, Y.
    rows_x = np.stack([s - beta * c, c + beta * s, zero], axis=-1)
    rows_y = np.stack([-delta * c, delta * s, zero + 1.0], axis=-1)
    A = np.concatenate([rows_x, rows_y], axis=-2)
    b_x, b_y = alpha + (beta * z_known - x_known) / m_2, gamma + delta * z_known / m_2
    b = np.concatenate([b_x, b_y], axis=-1)
    At = np.swapaxes(A, -1, -2)
    lw, rw, Y = np.moveaxis(np.linalg.solve(At @ A, At @ b[..., None])[..., 0], -1, 0)
    return np.stack([x_known[..., 0] / mass + rw, Y, z_known[..., 0] / mass + lw], axis=-1)


def spread(coefficients: Array, tilts: Array) -> float:
    """Return how far theta - phi spreads over the poses of one shape [rad].

    Parameters
    ----------
    coefficients : array, shape (K, 4)
    tilts : array, shape (K,)
    """
    lean = tilts - np.arctan(coefficients[:, 1])
    roll = np.arctan(coefficients[:, 3])
    return float(max(np.ptp(lean), np.ptp(roll)))


def height_gain(spread_angle: float) -> float:
    """Return sd(Z)/sd(X) of a twin pair on level ground: sqrt(1 + cos^2) / sin of the tilt."""
    return float(np.sqrt(1.0 + np.cos(spread_angle) ** 2) / np.abs(np.sin(spread_angle)))
