# SPDX-License-Identifier: Apache-2.0
"""CoM of each link of Muscolo et al. (2017), section 3.3 (n = 2), as printed and corrected.

Frames, angles and signs are those of :mod:`comcal.statics.published_chain`. A shin that is not
upright in pose c is written into the same equations; when it is, they are the paper's.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.errors import RankError
from comcal.robot.tree import Array
from comcal.statics.published_chain import (
    Bends,
    FootCad,
    LinkComs,
    PublishedChain,
    TotalCom,
    masses_under,
)
from comcal.statics.published_faults import CORRECTED, Fault

MIN_DETERMINANT = 1e-9
"""Smallest ``|det A| / (m_b m_c)^2`` that Cramer's rule accepts [1]."""


def rest_com(total: TotalCom, m_2: float, foot: FootCad) -> tuple[float, float]:
    """Return r_w, l_w of equations (23), (30), (31): the CoM of m_w from the ankle axle [m].

    Unlike those of :func:`~comcal.statics.published_coefficients.rest_com_two_poses`, they turn
    with the pose: both are in the axes of P.
    """
    m_w = m_2 - foot.m_u
    r_w = (total.X * m_2 - foot.m_u * foot.r_u) / m_w
    l_w = (total.Z * m_2 - foot.m_u * foot.l_u) / m_w - foot.U
    return r_w, l_w


def link_com_matrix(bends: Bends, m_b: float, m_c: float, *, faults: Fault = CORRECTED) -> Array:
    """Return A of equation (38), shape (4, 4), for the unknowns (r_b, l_b, r_c, l_c) [kg].

    Rows: x and z of pose b, (34) and (35); x and z of pose c, (36) and (37). Only E1 matters. The
    corrected determinant is 2 m_b^2 m_c^2 (1 - cos(theta_c - shin_c)), whatever theta_b.
    """
    s_b, c_b = np.sin(bends.theta_b), np.cos(bends.theta_b)
    s_c, c_c = np.sin(bends.theta_c), np.cos(bends.theta_c)
    s_s, c_s = np.sin(bends.shin_c), np.cos(bends.shin_c)
    sign = -1.0 if Fault.ROW_SIGN in faults else 1.0
    return np.array(
        [
            [m_b * c_b, m_b * s_b, m_c * c_b, m_c * s_b],
            [-m_b * s_b, m_b * c_b, -m_c * s_b, m_c * c_b],
            [m_b * c_s, m_b * s_s, sign * m_c * c_c, m_c * s_c],
            [-m_b * s_s, m_b * c_s, -m_c * s_c, m_c * c_c],
        ]
    )


def link_com_rhs(
    bends: Bends,
    rest_b: tuple[float, float],
    rest_c: tuple[float, float],
    chain: PublishedChain,
    m_w: float | None = None,
) -> Array:
    """Return (a_1, a_2, a_3, a_4) of equation (39) [kg m].

    Parameters
    ----------
    bends : Bends
    rest_b, rest_c : tuple of float
        (r_w, l_w) of the two poses, from :func:`rest_com` [m].
    chain : PublishedChain
    m_w : float, optional
        Mass above the ankles [kg] if it is not the chain's own (E6).
    """
    m_b, m_c, L_a, L_b = chain.m_b, chain.m_c, chain.foot.U, chain.L_b
    m_w = chain.m_w if m_w is None else m_w
    (r_wb, l_wb), (r_wc, l_wc) = rest_b, rest_c
    return np.array(
        [
            m_w * r_wb - m_c * L_b * np.sin(bends.theta_b),
            m_w * (l_wb + L_a) - m_b * L_a - m_c * L_b * np.cos(bends.theta_b) - m_c * L_a,
            m_w * r_wc - m_c * L_b * np.sin(bends.shin_c),
            m_w * (l_wc + L_a) - m_b * L_a - m_c * (L_a + L_b * np.cos(bends.shin_c)),
        ]
    )


def link_com_cramer(
    bends: Bends, m_b: float, m_c: float, rhs: npt.ArrayLike, *, faults: Fault = CORRECTED
) -> LinkComs:
    """Solve A u = a by Cramer's rule, equations (40)-(43).

    Parameters
    ----------
    bends : Bends
    m_b, m_c : float
        [kg].
    rhs : array, shape (4,)
        :func:`link_com_rhs` [kg m].
    faults : Fault
        E1 and E2 matter.

    Raises
    ------
    RankError
        If the determinant vanishes: poses b and c have the same shape.
    """
    A = link_com_matrix(bends, m_b, m_c, faults=faults)
    det = float(np.linalg.det(A))
    scaled = det / (m_b * m_c) ** 2
    if abs(scaled) < MIN_DETERMINANT:
        raise RankError(
            "configurations b and c have the same shape",
            measured=f"det A / (m_b m_c)^2 = {scaled:.1e}",
            limit=f"{MIN_DETERMINANT:.0e}",
            next_step="bend the knee further in configuration c",
        )
    numerators: list[float] = []
    for column in range(4):
        N = A.copy()
        if Fault.NUMERATOR_ENTRY in faults:
            N[3, 3] = m_c * np.sin(bends.theta_c)
        # In (43) the last column is replaced, and the wrong entry with it.
        N[:, column] = rhs
        numerators.append(float(np.linalg.det(N)))
    r_b, l_b, r_c, l_c = (n / det for n in numerators)
    return LinkComs(r_b, l_b, r_c, l_c)


def link_coms_from_totals(
    b: TotalCom, c: TotalCom, bends: Bends, chain: PublishedChain, *, faults: Fault = CORRECTED
) -> LinkComs:
    """Return the link CoMs when the total CoM is known in poses b and c: (30), (31), (38)-(43).

    The paper's section 4, and its remark that neither force sensors nor torques are needed then.

    Parameters
    ----------
    b, c : TotalCom
    bends : Bends
    chain : PublishedChain
    faults : Fault
        E1, E2, E6 and E7 matter.

    Raises
    ------
    RankError
        As :func:`link_com_cramer`.
    """
    chain, m_2 = masses_under(chain, faults)
    foot = chain.foot
    rest_b, rest_c = rest_com(b, m_2, foot), rest_com(c, m_2, foot)
    rhs = link_com_rhs(bends, rest_b, rest_c, chain, m_w=m_2 - foot.m_u)
    return link_com_cramer(bends, chain.m_b, chain.m_c, rhs, faults=faults)


def listing_closed_form(
    b: TotalCom, c: TotalCom, bends: Bends, chain: PublishedChain
) -> tuple[float, float]:
    """Return l_b, l_c [m] as the paper's MATLAB listing computes them.

    It uses the two height equations (35) and (37) alone and takes r_b = r_c = 0: not equation
    (41), which its comment names. That is why it notices neither E1, nor E2, nor E3.
    """
    m_b, m_c = chain.m_b, chain.m_c
    rest_b, rest_c = (rest_com(total, chain.m_2, chain.foot) for total in (b, c))
    _, B, _, C = link_com_rhs(bends, rest_b, rest_c, chain)
    c_b, c_c = np.cos(bends.theta_b), np.cos(bends.theta_c)
    det = m_b * m_c * c_b * (c_c - 1.0)
    return float(m_c * (B * c_c - C * c_b) / det), float(m_b * (C * c_b - B) / det)


def poses_required(n: int, *, faults: Fault = CORRECTED) -> int:
    """Return the number of poses for n links above the feet, measured by force alone.

    n + 1 as equation (21) has it (E4); 2n, one for each unknown, in truth.
    """
    return n + 1 if Fault.TOO_FEW_POSES in faults else 2 * n


def force_rows(pitch: npt.ArrayLike, masses: npt.ArrayLike, beta: npt.ArrayLike = 0.0) -> Array:
    r"""Return what force data say about the links: one equation for each pose.

    Parameters
    ----------
    pitch : array, shape (n_poses, n)
        Absolute pitch of every link [rad].
    masses : array, shape (n,)
        [kg].
    beta : array, shape (n_poses,) or scalar
        Equation (11).

    Returns
    -------
    rows : array, shape (n_poses, 2n)
        Coefficients [kg] of (r_1, l_1, r_2, l_2, ...) in :math:`m_2 (X - \beta Z) = m_2 \alpha`.
    """
    pitch = np.atleast_2d(np.asarray(pitch, dtype=np.float64))
    slope = np.broadcast_to(np.asarray(beta, dtype=np.float64), pitch.shape[:1])[:, None]
    s, c = np.sin(pitch), np.cos(pitch)
    rows = np.stack([c + slope * s, s - slope * c], axis=-1)
    return (np.asarray(masses, dtype=np.float64)[:, None] * rows).reshape(len(pitch), -1)
