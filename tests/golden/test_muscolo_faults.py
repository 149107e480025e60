# SPDX-License-Identifier: Apache-2.0
"""The faults of Muscolo et al. (2017), each alone and all together, with their figures in mm.

Two robots at 10 degrees: the one of the listing (one leg and the waist), for E1 to E3, and that of
Table 1 with both legs, whose joint torques are computed by hand statics, for E5 to E7.
Oracle: the printed equations, typed once more and evaluated in exact fractions.
"""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from comcal.errors import RankError
from comcal.statics.published import PlanarPose, published_route
from comcal.statics.published_chain import Bends, FootCad, LinkComs, PublishedChain, TotalCom
from comcal.statics.published_coefficients import coefficients_as_published
from comcal.statics.published_faults import (
    AS_PUBLISHED,
    CORRECTED,
    FAULT_TEXT,
    Fault,
    fault_codes,
)
from comcal.statics.published_links import (
    force_rows,
    link_com_matrix,
    link_coms_from_totals,
    poses_required,
)

G = 9.81
TEN = math.radians(10)
BENDS = Bends(TEN, TEN)
POSES = {"a": (0.0, 0.0), "b": (TEN, TEN), "c": (0.0, TEN), "c_tilted": (TEN, 2 * TEN)}

LISTING = PublishedChain(FootCad(6.72, 0.0, 0.02632, 0.100), 0.95, 2.10, 0.400, 0.94)
STRAIGHT = LinkComs(0.0, 0.200, 0.0, 0.250)
ASKEW = LinkComs(0.010, 0.200, -0.020, 0.250)

THIGHS, WAIST, THIGH_LENGTH = 2 * 1.16, 0.94, 0.500
TABLE_1 = PublishedChain(
    FootCad(2 * 6.72, 0.0, 0.02632, 0.100), 2 * 0.95, THIGHS + WAIST, 0.400, WAIST
)
TABLE_1_LINKS = LinkComs(
    0.0, 0.200, 0.0, (THIGHS * 0.250 + WAIST * THIGH_LENGTH) / (THIGHS + WAIST)
)


def total_com(chain, links, shin, thigh):
    """Return X, Z of the total CoM, body by body."""
    foot, s_b, c_b = chain.foot, math.sin(shin), math.cos(shin)
    s_c, c_c = math.sin(thigh), math.cos(thigh)
    bodies = (
        (foot.m_u, foot.r_u, foot.l_u),
        (chain.m_b, links.l_b * s_b + links.r_b * c_b, foot.U + links.l_b * c_b - links.r_b * s_b),
        (
            chain.m_c,
            chain.L_b * s_b + links.l_c * s_c + links.r_c * c_c,
            foot.U + chain.L_b * c_b + links.l_c * c_c - links.r_c * s_c,
        ),
    )
    mass = sum(m for m, _, _ in bodies)
    return sum(m * x for m, x, _ in bodies) / mass, sum(m * z for m, _, z in bodies) / mass


def sum_of_joint_torques(chain, links, shin, thigh):
    """Return M_2 about +y [N m]: parent on child, the tree rooted at the waist.

    What is above a joint would fall over it with the moment m g x; the lower link holds it, and
    what the upper link, its parent, exerts on the lower one is that very moment. The CoM of the
    waist is the hip, so the hip torque is that of nothing.
    """
    x_knee = chain.L_b * math.sin(shin)
    x_c = x_knee + links.l_c * math.sin(thigh) + links.r_c * math.cos(thigh)
    x_b = links.l_b * math.sin(shin) + links.r_b * math.cos(shin)
    knees = chain.m_c * G * (x_c - x_knee)
    ankles = G * (chain.m_b * x_b + chain.m_c * x_c)
    return knees + ankles


def foot_wrenches(chain, links, shin, thigh):
    """Return the wrenches at points 0 and 1: half of the load each, on level ground."""
    X, _ = total_com(chain, links, shin, thigh)
    half = chain.m_2 * G / 2
    wrench = np.array([0.0, 0.0, half, 0.0, -half * X, 0.0])
    return wrench, wrench


def measured(chain, links, name):
    shin, thigh = POSES[name]
    w_0, w_1 = foot_wrenches(chain, links, shin, thigh)
    M_2 = [0.0, sum_of_joint_torques(chain, links, shin, thigh), 0.0]
    right = coefficients_as_published(w_0, w_1, 0.2, M_2)
    with_M_2 = coefficients_as_published(w_0, w_1, 0.2, M_2, faults=Fault.INTERNAL_TORQUES)
    alpha = float(right.alpha)
    return PlanarPose(shin, thigh, alpha, float(right.beta), alpha - float(with_M_2.alpha))


def route(chain, links, faults, factor=1.0):
    a, b, c, c_tilted = (measured(chain, links, name) for name in POSES)
    return published_route(a, b, c, chain, c_tilted=c_tilted, faults=faults, factor=factor)


def from_true_totals(links, faults):
    """Return r_b, l_b, r_c, l_c [mm] for the listing's robot, as its own check feeds them."""
    b, c = (TotalCom(*total_com(LISTING, links, *POSES[name])) for name in "bc")
    return link_coms_from_totals(b, c, BENDS, LISTING, faults=faults).as_array() * 1e3


def mm(result):
    return result.links.as_array() * 1e3


def one_decimal(*values):
    return pytest.approx(values, abs=0.05)


@pytest.mark.parametrize(
    ("links", "faults", "figures"),
    [
        (STRAIGHT, CORRECTED, (0.0, 200.0, 0.0, 250.0)),
        (ASKEW, CORRECTED, (10.0, 200.0, -20.0, 250.0)),
        (STRAIGHT, Fault.ROW_SIGN, (0.0, 200.0, 0.0, 250.0)),
        (ASKEW, Fault.ROW_SIGN, (-11.9, 450.7, -10.1, 136.6)),
        (STRAIGHT, Fault.NUMERATOR_ENTRY, (2561.9, 505.3, -1158.9, 250.0)),
        (ASKEW, Fault.NUMERATOR_ENTRY, (2575.9, 505.3, -1187.1, 250.0)),
        (STRAIGHT, Fault.ROW_SIGN | Fault.NUMERATOR_ENTRY, (1290.7, 20292.6, -583.9, 250.0)),
        (ASKEW, Fault.ROW_SIGN | Fault.NUMERATOR_ENTRY, (374.5, 20543.4, -598.1, 136.6)),
    ],
)
def test_e1_and_e2_spoil_the_links_even_with_true_total_coms(links, faults, figures):
    assert from_true_totals(links, faults) == one_decimal(*figures)


@pytest.mark.parametrize(
    ("links", "true_height", "printed_height"), [(STRAIGHT, 207.7, 102.2), (ASKEW, 208.4, 102.9)]
)
def test_e3_takes_the_bent_robot_for_a_tilted_one(links, true_height, printed_height):
    right, wrong = (route(LISTING, links, f) for f in (CORRECTED, Fault.RIGID_BEND))
    heights = [right.c.Z * 1e3, wrong.c.Z * 1e3]
    assert heights == one_decimal(true_height, printed_height)
    assert wrong.b == right.b
    assert mm(right) == pytest.approx(links.as_array() * 1e3, abs=1e-9)
    assert np.max(np.abs(mm(wrong) - mm(right))) > 6000.0


def test_e4_n_plus_1_poses_leave_one_unknown_open():
    pitches = [POSES[name] for name in POSES]
    masses = [LISTING.m_b, LISTING.m_c]
    assert poses_required(2, faults=Fault.TOO_FEW_POSES) == 3
    assert np.linalg.matrix_rank(force_rows(pitches[:3], masses)) == 3
    assert poses_required(2) == 4
    assert np.linalg.matrix_rank(force_rows(pitches, masses)) == 4
    with pytest.raises(RankError, match="3 equations for 4 unknowns"):
        route(LISTING, STRAIGHT, Fault.TOO_FEW_POSES)


def test_e5_internal_torques_move_x_by_35_mm():
    """M_2 in (10), with either sign, on the robot of Table 1 in pose b."""
    X, _ = total_com(TABLE_1, TABLE_1_LINKS, *POSES["b"])
    w_0, w_1 = foot_wrenches(TABLE_1, TABLE_1_LINKS, *POSES["b"])
    M_2 = [0.0, sum_of_joint_torques(TABLE_1, TABLE_1_LINKS, *POSES["b"]), 0.0]

    def x_mm(faults, factor=1.0):
        k = coefficients_as_published(w_0, w_1, 0.2, M_2, faults=faults, factor=factor)
        return 1e3 * float(k.alpha)

    assert pytest.approx(25.524, abs=0.0005) == 1e3 * X
    assert x_mm(CORRECTED) == pytest.approx(25.524, abs=0.0005)
    assert x_mm(Fault.INTERNAL_TORQUES, +1.0) == pytest.approx(-9.8, abs=0.05)
    assert x_mm(Fault.INTERNAL_TORQUES, -1.0) == pytest.approx(60.9, abs=0.05)


@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_e5_alone_moves_the_links_by_decimetres(factor):
    shift = mm(route(TABLE_1, TABLE_1_LINKS, Fault.INTERNAL_TORQUES, factor))
    expected = {
        1.0: (0.0, -686.3, 0.0, -322.1),
        -1.0: (0.0, 1086.3, 0.0, 966.3),
    }
    assert shift == one_decimal(*expected[factor])


def test_e6_without_the_feet_the_rest_of_the_robot_weighs_less_than_nothing():
    """The feet weigh 72 % of the robot, and (18) takes their mass away twice."""
    m_2 = LISTING.m_w
    assert m_2 - LISTING.foot.m_u == pytest.approx(-3.67)
    assert mm(route(LISTING, STRAIGHT, Fault.MASS_WITHOUT_FEET))[1] == pytest.approx(
        -545.7, abs=0.05
    )


def test_e6_the_cut_decides_which_masses_belong_together():
    """A sensor above the feet gives the same links, if m_2 and m_u are those above its cut."""
    above_cut = PublishedChain(
        FootCad(0.0, 0.0, 0.0, LISTING.foot.U), LISTING.m_b, LISTING.m_c, LISTING.L_b
    )
    assert mm(route(above_cut, ASKEW, CORRECTED)) == pytest.approx(
        mm(route(LISTING, ASKEW, CORRECTED)), abs=1e-9
    )


def test_e7_both_legs_in_parallel_are_another_robot_than_the_listing():
    assert TABLE_1.foot.m_u == pytest.approx(13.44)
    assert (TABLE_1.m_b, TABLE_1.m_c) == pytest.approx((1.90, 3.26))
    assert mm(route(TABLE_1, TABLE_1_LINKS, CORRECTED)) == pytest.approx(
        (0.0, 200.0, 0.0, 322.09), abs=0.005
    )
    one_leg = TABLE_1.one_leg()
    assert one_leg.foot.m_u == pytest.approx(LISTING.foot.m_u)
    assert (one_leg.m_b, one_leg.m_c) == pytest.approx((LISTING.m_b, LISTING.m_c))
    assert mm(route(TABLE_1, TABLE_1_LINKS, Fault.ONE_LEG)) == one_decimal(0.0, 46.9, 0.0, 262.6)


def determinant(rows):
    """Return a determinant by Laplace's expansion; exact for fractions."""
    if len(rows) == 1:
        return rows[0][0]
    minors = ([row[:k] + row[k + 1 :] for row in rows[1:]] for k in range(len(rows)))
    return sum(
        (-1) ** k * entry * determinant(minor)
        for k, (entry, minor) in enumerate(zip(rows[0], minors, strict=True))
    )


def printed(chain, links, *, e1, e2, e3, k):
    """Return r_b, l_b, r_c, l_c [mm] by the equations as printed; k = 0 leaves M_2 out."""
    foot = chain.foot
    m_a, r_a, l_a, L_a = (Fraction(v) for v in (foot.m_u, foot.r_u, foot.l_u, foot.U))
    m_b, m_c, L_b = (Fraction(v) for v in (chain.m_b, chain.m_c, chain.L_b))
    m_w = m_b + m_c
    m_2 = m_a + m_w
    s, c = Fraction(math.sin(TEN)), Fraction(math.cos(TEN))

    def alpha(name):
        X, _ = total_com(chain, links, *POSES[name])
        M_2 = sum_of_joint_torques(chain, links, *POSES[name])
        return Fraction(X) - k * Fraction(M_2) / (m_2 * Fraction(G))

    def rest(alpha_upright, alpha_tilted):
        """Return l_w, r_w of (14) and (16) for a shape upright and at 10 degrees, beta = 0."""
        r_w = (m_2 * alpha_upright - m_a * r_a) / m_w
        return ((m_2 * alpha_tilted - m_a * r_a) / m_w - r_w * c) / s, r_w

    def height_when_tilted(l_w, r_w):
        return (m_a * l_a + m_w * (L_a + l_w * c - r_w * s)) / m_2

    def height_when_upright(l_w, _):
        return (m_a * l_a + m_w * (L_a + l_w)) / m_2

    Z_b = height_when_tilted(*rest(alpha("a"), alpha("b")))
    if e3:
        Z_c = height_when_tilted(*rest(alpha("a"), alpha("c")))
    else:
        Z_c = height_when_upright(*rest(alpha("c"), alpha("c_tilted")))
    r_wb, r_wc = ((alpha(name) * m_2 - m_a * r_a) / m_w for name in "bc")
    l_wb, l_wc = ((Z * m_2 - m_a * l_a) / m_w - L_a for Z in (Z_b, Z_c))
    known = [
        m_w * r_wb - m_c * L_b * s,
        m_w * (l_wb + L_a) - m_b * L_a - m_c * L_b * c - m_c * L_a,
        m_w * r_wc,
        m_w * (l_wc + L_a) - m_b * L_a - m_c * (L_a + L_b),
    ]

    def matrix(last):
        return [
            [m_b * c, m_b * s, m_c * c, m_c * s],
            [-m_b * s, m_b * c, -m_c * s, m_c * c],
            [m_b, 0, (-1 if e1 else 1) * m_c * c, m_c * s],
            [0, m_b, -m_c * s, last],
        ]

    found = []
    for column in range(4):
        numerator = matrix(m_c * s if e2 else m_c * c)
        for row, value in zip(numerator, known, strict=True):
            row[column] = value
        found.append(float(1000 * determinant(numerator) / determinant(matrix(m_c * c))))
    return found


@pytest.mark.parametrize(("e1", "e2", "e3"), list(product((False, True), repeat=3)))
@pytest.mark.parametrize("k", [0, 1, -1])
def test_every_combination_of_faults_is_the_printed_paper(e1, e2, e3, k):
    faults = CORRECTED
    for on, fault in (
        (e1, Fault.ROW_SIGN),
        (e2, Fault.NUMERATOR_ENTRY),
        (e3, Fault.RIGID_BEND),
        (k != 0, Fault.INTERNAL_TORQUES),
    ):
        faults |= fault if on else CORRECTED
    for chain, links in ((LISTING, ASKEW), (TABLE_1, TABLE_1_LINKS)):
        result = mm(route(chain, links, faults, float(k)))
        expected = printed(chain, links, e1=e1, e2=e2, e3=e3, k=k)
        assert result == pytest.approx(expected, rel=1e-9, abs=1e-7)


@pytest.mark.parametrize(
    ("chain", "links", "factor", "figures"),
    [
        (LISTING, STRAIGHT, 1.0, (-1290.7, -39242.9, 583.9, -250.0)),
        (LISTING, STRAIGHT, -1.0, (-2371.5, 8462.1, 1072.8, 33034.6)),
        (LISTING, ASKEW, 1.0, (-97.6, -39493.6, 598.1, -136.6)),
        (LISTING, ASKEW, -1.0, (-5402.1, 9156.7, 1032.6, 32720.4)),
        (TABLE_1, TABLE_1_LINKS, 1.0, (-1290.7, -33761.9, 752.3, -322.1)),
        (TABLE_1, TABLE_1_LINKS, -1.0, (-1231.8, 16007.1, 717.9, 34968.1)),
    ],
)
def test_all_printed_formulas_together(chain, links, factor, figures):
    assert mm(route(chain, links, AS_PUBLISHED, factor)) == one_decimal(*figures)


def test_each_fault_has_a_code_and_a_line():
    assert [FAULT_TEXT[fault].split()[0] for fault in Fault] == [f"E{i}" for i in range(1, 8)]
    assert fault_codes(CORRECTED) == "none"
    assert fault_codes(AS_PUBLISHED) == "E1+E2+E3+E4+E5"


def test_e1_changes_one_entry_of_the_matrix():
    right = link_com_matrix(BENDS, 0.95, 2.10)
    wrong = link_com_matrix(BENDS, 0.95, 2.10, faults=Fault.ROW_SIGN)
    assert np.argwhere(right != wrong).tolist() == [[2, 2]]
    assert wrong[2, 2] == -right[2, 2]
