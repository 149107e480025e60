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

The functions of single poses only add, multiply and divide, so they take symbols as well:
:mod:`comcal.symbolic.coefficients` evaluates them on those.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from comcal.robot.tree import Array

Row: TypeAlias = tuple[Array, Array, Array]
"""p, q and a of one equation p l + q r = a."""

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


def known_part(mass: Array, foot: FootSide) -> tuple[Array, Array]:
    """Return x and z of the CoM if all that tilts were a point on the ankle axis, in P [m].

    Parameters
    ----------
    mass : array
        m_2, in a shape that broadcasts with those of *foot* [kg].
    foot : FootSide
    """
    m_w = mass - foot.mass
    x = (foot.mass * foot.r + m_w * foot.ankle_x) / mass
    z = (foot.mass * foot.l + m_w * foot.ankle_z) / mass
    return x, z


def tilt_row(
    line: tuple[Array, Array], known: tuple[Array, Array], turn: tuple[Array, Array]
) -> Row:
    """Return the balance of one pose: p, q and a of p l + q r = a.

    Parameters
    ----------
    line : tuple of array
        alpha [m] and beta [1].
    known : tuple of array
        As :func:`known_part` returns [m].
    turn : tuple of array
        Sine and cosine of the tilt.

    Notes
    -----
    The unknowns are l = m_w l_w / m_2 and r = m_w r_w / m_2 [m]: (16) and (17) put into (14).
    """
    (alpha, beta), (x, z), (s, c) = line, known, turn
    return s - beta * c, c + beta * s, alpha - x + beta * z


def turned_height(
    known: tuple[Array, Array], rest: tuple[Array, Array], turn: tuple[Array, Array]
) -> Array:
    """Return z of the CoM in a tilted pose, (17) [m].

    Parameters
    ----------
    known : tuple of array
        As :func:`known_part` returns [m].
    rest : tuple of array
        l and r [m].
    turn : tuple of array
        Sine and cosine of the tilt.
    """
    return known[1] + rest[0] * turn[1] - rest[1] * turn[0]


def determinants(first: Row, second: Row) -> tuple[Array, Array, Array]:
    """Return D_l, D_r and D of two equations p l + q r = a: l = D_l / D, r = D_r / D.

    Parameters
    ----------
    first, second : tuple of array
        p, q and a of each.
    """
    (p_1, q_1, a_1), (p_2, q_2, a_2) = first, second
    return a_2 * q_1 - a_1 * q_2, p_2 * a_1 - p_1 * a_2, p_2 * q_1 - p_1 * q_2


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
    The least-squares solution of the X and Y lines of all poses; *not* determined when
    theta - phi is the same in all of them (see :func:`spread`).
    """
    alpha, beta, gamma, delta = np.moveaxis(coefficients, -1, 0)
    turn = s, c = np.sin(tilts), np.cos(tilts)
    known = known_part(mass[..., None], replace(foot, mass=foot.mass[..., None]))
    p, q, a = tilt_row((alpha, beta), known, turn)
    # Y = gamma + delta (z + c l - s r) for all poses, less the mean over them: Y drops out.
    u = np.concatenate([p, _from_mean(-delta * c)], axis=-1)
    v = np.concatenate([q, _from_mean(delta * s)], axis=-1)
    w = np.concatenate([a, _from_mean(gamma + delta * known[1])], axis=-1)
    uv = np.sum(u * v, axis=-1)
    D_l, D_r, D = determinants(
        (np.sum(u * u, axis=-1), uv, np.sum(u * w, axis=-1)),
        (uv, np.sum(v * v, axis=-1), np.sum(v * w, axis=-1)),
    )
    l, r = D_l / D, D_r / D  # noqa: E741 - the paper's letter
    height = turned_height(known, (l[..., None], r[..., None]), turn)
    Y = np.mean(gamma + delta * height, axis=-1)
    return np.stack([known[0][..., 0] + r, Y, known[1][..., 0] + l], axis=-1)


def _from_mean(x: Array) -> Array:
    return x - np.mean(x, axis=-1, keepdims=True)


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
