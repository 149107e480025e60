# SPDX-License-Identifier: Apache-2.0
"""Coefficients and total CoM of Muscolo et al. (2017), sections 2.1 to 2.4, as printed.

Everything is SI, in the stance frame P (x to the toes, y left, z up from the sole), and every
wrench is ground on robot. These functions show what the paper computes. For measuring a robot,
use the balance of any foot placement, which has neither the restriction to p = (0, +-l, 0) nor M_2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import RankError
from comcal.robot.tree import Array
from comcal.statics.published_chain import FootCad
from comcal.statics.published_faults import CORRECTED, Fault

MIN_TILT = 1e-6
"""Smallest determinant that f accepts: about the angle between the poses, seen from gravity [1]."""


@dataclass(frozen=True)
class PublishedCoefficients:
    """Equations (10)-(13): alpha, gamma [m] and beta, delta [1], each of shape (...)."""

    alpha: Array
    beta: Array
    gamma: Array
    delta: Array


@dataclass(frozen=True)
class TiltedLine:
    """One pose of a shape: its tilt, and the sagittal line of (14), X = alpha + beta Z, in P.

    Parameters
    ----------
    theta : float
        Tilt about the ankle axle, positive to the toes [rad].
    alpha, beta : float
        [m], [1].
    """

    theta: float
    alpha: float
    beta: float = 0.0


def internal_torques(torques: npt.ArrayLike, axes: npt.ArrayLike) -> Array:
    r"""Sum all joint torques about the axes of P, as M_2 of equation (3).

    Parameters
    ----------
    torques : array, shape (..., n_joints)
        Of parent on child about +axis, the tree rooted at the waist [N m].
    axes : array, shape (n_joints, 3)
        Unit vectors of the joint axes in P.

    Returns
    -------
    M_2 : array, shape (..., 3)
        :math:`(\sum M_{roll}, \sum M_{pitch}, \sum M_{yaw})` [N m].

    Notes
    -----
    Rooting the same tree at a foot turns the sign of every torque on the way: this sum is a
    matter of convention, not of physics.
    """
    return np.asarray(torques, dtype=np.float64) @ np.asarray(axes, dtype=np.float64)


def coefficients_as_published(
    wrench_0: npt.ArrayLike,
    wrench_1: npt.ArrayLike,
    half_stance: npt.ArrayLike,
    M_2: npt.ArrayLike = 0.0,
    *,
    faults: Fault = CORRECTED,
    factor: float = 1.0,
) -> PublishedCoefficients:
    r"""Return alpha, beta, gamma, delta of equations (10)-(13).

    Parameters
    ----------
    wrench_0, wrench_1 : array, shape (..., 6)
        Force, moment of the ground on the robot at the right foot (point 0, y = -l) and at the
        left foot (point 1, y = +l): axes of P, moment about the point itself [N, N m].
    half_stance : array, shape (...)
        l, half the distance of the two points [m].
    M_2 : array, shape (..., 3) or scalar
        :func:`internal_torques`; has an effect only with :attr:`Fault.INTERNAL_TORQUES`.
    faults : Fault
        Only E5 matters here.
    factor : float
        +1 or -1: the sign the reader gives to M_2, which the paper leaves open.

    Returns
    -------
    PublishedCoefficients
        NaN where the feet carry nothing.

    Notes
    -----
    The points lie at :math:`p_{0,1} = (0, \mp l, 0)`, so a lateral force has no moment about x
    and a sagittal one none about y.
    """
    w_0 = np.asarray(wrench_0, dtype=np.float64)
    w_1 = np.asarray(wrench_1, dtype=np.float64)
    F, M = w_0[..., :3] + w_1[..., :3], w_0[..., 3:] + w_1[..., 3:]
    if Fault.INTERNAL_TORQUES in faults:
        M = M + factor * np.asarray(M_2, dtype=np.float64)
    Fz = np.where(F[..., 2] == 0.0, np.nan, F[..., 2])
    lever = np.asarray(half_stance, dtype=np.float64) * (w_1[..., 2] - w_0[..., 2])
    return PublishedCoefficients(
        alpha=-M[..., 1] / Fz,
        beta=F[..., 0] / Fz,
        gamma=(M[..., 0] + lever) / Fz,
        delta=F[..., 1] / Fz,
    )


def rest_com_two_poses(
    a: TiltedLine, b: TiltedLine, m_2: float, foot: FootCad
) -> tuple[float, float]:
    r"""Return l_w, r_w: the CoM of all above the ankle axle, seen from the axle at theta = 0.

    Parameters
    ----------
    a, b : TiltedLine
        Two poses of one shape; the paper has the first at theta = 0.
    m_2 : float
        Mass that the sensors carry [kg]; m_w = m_2 - m_u (18).
    foot : FootCad

    Returns
    -------
    l_w, r_w : float
        Along z and along x [m].

    Raises
    ------
    RankError
        If the two poses do not differ relative to gravity, or nothing weighs above the ankles.

    Notes
    -----
    (16) and (17) in (14) give for each pose

    .. math::
        l_w (s - \beta c) + r_w (c + \beta s)
        = [m_2 \alpha - m_u r_u + \beta (m_u l_u + m_w U)] / m_w

    with s, c of its own tilt: two equations for l_w and r_w. With beta = tan(phi) the determinant
    is :math:`\sin((\theta_b - \phi_b) - (\theta_a - \phi_a)) / (\cos\phi_a \cos\phi_b)`.
    """
    if m_2 == foot.m_u:
        raise RankError(
            "there is no mass above the ankles",
            measured=f"m_2 = {m_2:.4g} kg",
            limit=f"more than m_u = {foot.m_u:.4g} kg",
            next_step="check the masses of the feet and of the whole robot",
        )
    l_a, r_a, known_a = _equation(a, m_2, foot)
    l_b, r_b, known_b = _equation(b, m_2, foot)
    det = l_b * r_a - l_a * r_b
    if abs(det) < MIN_TILT:
        raise RankError(
            "two poses of one shape do not differ relative to gravity",
            measured=f"determinant {det:.1e}, tilts {a.theta:.4f} and {b.theta:.4f} rad",
            limit=f"{MIN_TILT:.0e}",
            next_step="tilt the whole body further about the ankles",
        )
    return (known_b * r_a - known_a * r_b) / det, (known_a * l_b - known_b * l_a) / det


def _equation(pose: TiltedLine, m_2: float, foot: FootCad) -> tuple[float, float, float]:
    """Return the coefficients of l_w and r_w and the right-hand side of one pose."""
    s, c = float(np.sin(pose.theta)), float(np.cos(pose.theta))
    m_w = m_2 - foot.m_u
    height = foot.m_u * foot.l_u + m_w * foot.U
    known = (m_2 * pose.alpha - foot.m_u * foot.r_u + pose.beta * height) / m_w
    return s - pose.beta * c, c + pose.beta * s, known


def total_com_two_poses(
    a: TiltedLine, b: TiltedLine, m_2: float, foot: FootCad
) -> tuple[float, float]:
    """Return X_2B, Z_2B, the CoM in pose *b*: f of equations (19), (22), (28), (29).

    Parameters are those of :func:`rest_com_two_poses`. Exchange *a* and *b* for equation (20), the
    CoM in the other pose.

    Returns
    -------
    X, Z : float
        CoM of what the sensors carry, in P [m]. Z is (17) with the l_w, r_w found; X is (14).

    Raises
    ------
    RankError
        As :func:`rest_com_two_poses`.

    Notes
    -----
    True only if the two poses are ONE rigid body above the ankle axle.

    Examples
    --------
    CoM 0.5 m above an axle at z = 0.1 m, feet without mass, tilted by 30 deg on level ground:

    >>> foot = FootCad(m_u=0.0, r_u=0.0, l_u=0.0, U=0.1)
    >>> X, Z = total_com_two_poses(TiltedLine(0.0, 0.0), TiltedLine(np.pi / 6, 0.25), 10.0, foot)
    >>> round(X, 6), round(Z, 6)
    (0.25, 0.533013)
    """
    l_w, r_w = rest_com_two_poses(a, b, m_2, foot)
    rest = foot.U + l_w * float(np.cos(b.theta)) - r_w * float(np.sin(b.theta))
    Z = (foot.m_u * foot.l_u + (m_2 - foot.m_u) * rest) / m_2
    return b.alpha + b.beta * Z, Z
