# SPDX-License-Identifier: Apache-2.0
"""The numerical example of Muscolo et al. (2017), section 4, and the corrected formulas behind it.

Oracle: the chain in complex numbers, z + j x, where a pitch by phi is a factor exp(j phi). It
shares no line, and no sign, with the formulas under test.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import sympy as sp

from comcal.errors import RankError
from comcal.statics.published import PlanarPose, published_route
from comcal.statics.published_chain import Bends, FootCad, PublishedChain, TotalCom
from comcal.statics.published_coefficients import (
    TiltedLine,
    coefficients_as_published,
    internal_torques,
    rest_com_two_poses,
    total_com_two_poses,
)
from comcal.statics.published_links import (
    force_rows,
    link_com_matrix,
    link_com_rhs,
    link_coms_from_totals,
    listing_closed_form,
    poses_required,
    rest_com,
)

TEN = math.radians(10)
LISTING = PublishedChain(FootCad(6.72, 0.0, 0.02632, 0.100), 0.95, 1.16 + 0.94, 0.400, 0.94)
ODD = PublishedChain(FootCad(5.3, 0.021, 0.034, 0.083), 1.7, 2.9, 0.37, 0.8)
ODD_LINKS = (0.013, 0.171, -0.027, 0.294)


def total_com(chain, links, shin, thigh):
    """Return the total CoM of the chain as z + j x."""
    r_b, l_b, r_c, l_c = links
    foot = chain.foot
    ankle = foot.U
    knee = ankle + chain.L_b * cmath.exp(1j * shin)
    moment = (
        foot.m_u * complex(foot.l_u, foot.r_u)
        + chain.m_b * (ankle + complex(l_b, r_b) * cmath.exp(1j * shin))
        + chain.m_c * (knee + complex(l_c, r_c) * cmath.exp(1j * thigh))
    )
    return moment / (foot.m_u + chain.m_b + chain.m_c)


def given(chain, links, shin, thigh):
    """Return the same as the formulas take it."""
    com = total_com(chain, links, shin, thigh)
    return TotalCom(com.imag, com.real)


def measured(chain, links, shin, thigh, slope=0.0):
    """Return what the feet feel: the line along gravity through the CoM."""
    com = total_com(chain, links, shin, thigh)
    return PlanarPose(shin, thigh, com.imag - math.tan(slope) * com.real, math.tan(slope))


def listing_matlab():
    """Return l_b, l_c in mm: the listing of section 4.2 line by line, with ``mu`` for ``ma``."""
    thb = thc = 10 * math.pi / 180
    ma, mb, mc = 6.72, 0.95, 1.16 + 0.94
    mw = mb + mc
    m2 = ma + mw
    la, La, Lb = 26.32, 100.0, 400.0
    lb, lc = 200.0, 250.0
    z2b = (ma * la + mb * (La + lb * math.cos(thb)) + mc * (La + (Lb + lc) * math.cos(thb))) / m2
    z2c = (ma * la + mb * (La + lb) + mc * (La + Lb + lc * math.cos(thc))) / m2
    lwb = (z2b * m2 - ma * la) / mw - La
    lwc = (z2c * m2 - ma * la) / mw - La
    B = mw * (lwb + La) - mb * La - mc * Lb * math.cos(thb) - mc * La
    C = mw * (lwc + La) - mb * La - mc * (La + Lb)
    det = mb * mc * math.cos(thb) * (math.cos(thc) - 1)
    return (
        mc * (B * math.cos(thc) - C * math.cos(thb)) / det,
        mb * (C * math.cos(thb) - B) / det,
    )


def test_listing_gives_200_and_250_mm():
    b, c = (given(LISTING, (0, 0.2, 0, 0.25), *pose) for pose in ((TEN, TEN), (0, TEN)))
    l_b, l_c = listing_closed_form(b, c, Bends(TEN, TEN), LISTING)
    assert l_b * 1e3 == pytest.approx(200.0, abs=1e-9)
    assert l_c * 1e3 == pytest.approx(250.0, abs=1e-9)
    assert (l_b * 1e3, l_c * 1e3) == pytest.approx(listing_matlab(), abs=1e-9)


def test_listing_cannot_see_a_com_beside_the_link():
    """It assumes r = 0, which is why the paper's own check passes over faults E1 to E3."""
    b, c = (given(LISTING, (0.01, 0.2, -0.02, 0.25), *p) for p in ((TEN, TEN), (0, TEN)))
    l_b, l_c = listing_closed_form(b, c, Bends(TEN, TEN), LISTING)
    assert abs(l_b - 0.2) > 0.01 or abs(l_c - 0.25) > 0.01


@pytest.mark.parametrize("links", [(0, 0.2, 0, 0.25), (0.01, 0.2, -0.02, 0.25)])
def test_corrected_formulas_return_the_links_exactly(links):
    b, c = (given(LISTING, links, *pose) for pose in ((TEN, TEN), (0, TEN)))
    found = link_coms_from_totals(b, c, Bends(TEN, TEN), LISTING)
    assert found.as_array() == pytest.approx(links, abs=1e-12)


@pytest.mark.parametrize("slope", [0.0, 0.07])
@pytest.mark.parametrize("shins", [(0.0, 0.0), (-0.31, -0.04)])
def test_corrected_route_returns_the_links_from_four_poses(slope, shins):
    a_shin, c_shin = shins
    a, b, c, c_tilted = (
        measured(ODD, ODD_LINKS, shin, thigh, slope)
        for shin, thigh in (
            (a_shin, a_shin),
            (0.29, 0.29),
            (c_shin, 0.61),
            (c_shin + 0.33, 0.94),
        )
    )
    result = published_route(a, b, c, ODD, c_tilted=c_tilted)
    assert result.links.as_array() == pytest.approx(ODD_LINKS, abs=1e-12)
    for com, pose in ((result.b, (0.29, 0.29)), (result.c, (c_shin, 0.61))):
        truth = total_com(ODD, ODD_LINKS, *pose)
        found = (com.X, com.Z)
        assert found == pytest.approx((truth.imag, truth.real), abs=1e-12)


def test_three_poses_leave_the_height_of_c_open():
    a, b, c = (measured(ODD, ODD_LINKS, *pose) for pose in ((0, 0), (0.3, 0.3), (0, 0.3)))
    with pytest.raises(RankError, match="height of the CoM in configuration c"):
        published_route(a, b, c, ODD)


def truth_system(bends):
    """Return the corrected matrix, the true unknowns and the right-hand side of one example."""
    b = given(ODD, ODD_LINKS, bends.theta_b, bends.theta_b)
    c = given(ODD, ODD_LINKS, bends.shin_c, bends.theta_c)
    rest_b, rest_c = (rest_com(total, ODD.m_2, ODD.foot) for total in (b, c))
    A = link_com_matrix(bends, ODD.m_b, ODD.m_c)
    return A, np.array(ODD_LINKS), link_com_rhs(bends, rest_b, rest_c, ODD)


UPRIGHT, LEANING = Bends(0.31, 0.47), Bends(0.31, 0.47, -0.22)


@pytest.mark.parametrize("bends", [UPRIGHT, LEANING])
def test_matrix_and_right_hand_side_agree_with_the_complex_chain(bends):
    A, u, a = truth_system(bends)
    assert A @ u == pytest.approx(a, abs=1e-13)


@pytest.mark.parametrize(
    ("bends", "entry"),
    [
        (bends, entry)
        for bends in (UPRIGHT, LEANING)
        for entry in np.ndindex(4, 4)
        if link_com_matrix(bends, ODD.m_b, ODD.m_c)[entry] != 0.0
    ],
)
def test_one_wrong_sign_in_the_matrix_is_noticed(bends, entry):
    """Every term weighs more than a gram metre at these values, so no sign can hide."""
    A, u, a = truth_system(bends)
    A[entry] *= -1.0
    assert np.max(np.abs(A @ u - a)) > 1e-3


@pytest.mark.parametrize("entry", range(4))
def test_one_wrong_sign_in_the_right_hand_side_is_noticed(entry):
    A, u, a = truth_system(LEANING)
    a[entry] *= -1.0
    assert np.max(np.abs(A @ u - a)) > 1e-3


def test_determinant_is_that_of_the_complex_system():
    """det A = |det E|^2 = 2 m_b^2 m_c^2 (1 - cos(theta_c - shin_c)), derived symbolically."""
    tb, tc, ts = sp.symbols("theta_b theta_c theta_s", real=True)
    mb, mc = sp.symbols("m_b m_c", positive=True)
    E = sp.Matrix(
        [
            [mb * sp.exp(sp.I * tb), mc * sp.exp(sp.I * tb)],
            [mb * sp.exp(sp.I * ts), mc * sp.exp(sp.I * tc)],
        ]
    )
    closed = 2 * mb**2 * mc**2 * (1 - sp.cos(tc - ts))
    square = sp.expand(E.det() * sp.conjugate(E.det()))
    assert sp.simplify((square - closed).rewrite(sp.cos)) == 0
    for bends in (UPRIGHT, LEANING):
        det = np.linalg.det(link_com_matrix(bends, ODD.m_b, ODD.m_c))
        values = {tb: bends.theta_b, tc: bends.theta_c, ts: bends.shin_c, mb: ODD.m_b, mc: ODD.m_c}
        assert det == pytest.approx(float(closed.subs(values)), rel=1e-12)


@pytest.mark.parametrize("shin", [0.0, 0.4])
def test_equal_shapes_are_refused(shin):
    b = given(ODD, ODD_LINKS, shin, shin)
    with pytest.raises(RankError, match="same shape"):
        link_coms_from_totals(b, b, Bends(shin, shin, shin), ODD)


FOOT = ODD.foot
POSE_A, POSE_B = (
    TiltedLine(theta, com.imag - beta * com.real, beta)
    for theta, beta in ((-0.12, 0.05), (0.34, -0.03))
    for com in (total_com(ODD, ODD_LINKS, theta, theta),)
)


def test_two_poses_give_the_total_com_on_any_slope():
    """f by its closed form against the chain, and against (14), (16), (17) solved symbolically."""
    truth = total_com(ODD, ODD_LINKS, POSE_B.theta, POSE_B.theta)
    found = total_com_two_poses(POSE_A, POSE_B, ODD.m_2, FOOT)
    assert found == pytest.approx((truth.imag, truth.real), abs=1e-13)

    l_w, r_w = sp.symbols("l_w r_w")
    w = l_w + sp.I * r_w
    equations = []
    for pose in (POSE_A, POSE_B):
        turned = w * (sp.cos(pose.theta) + sp.I * sp.sin(pose.theta))
        z, x = turned.as_real_imag()
        z, x = (
            sp.expand(v).subs({sp.re(l_w): l_w, sp.re(r_w): r_w, sp.im(l_w): 0, sp.im(r_w): 0})
            for v in (z, x)
        )
        X = (FOOT.m_u * FOOT.r_u + ODD.m_w * x) / ODD.m_2
        Z = (FOOT.m_u * FOOT.l_u + ODD.m_w * (FOOT.U + z)) / ODD.m_2
        equations.append(X - pose.alpha - pose.beta * Z)
    solved = sp.solve(equations, [l_w, r_w])
    assert rest_com_two_poses(POSE_A, POSE_B, ODD.m_2, FOOT) == pytest.approx(
        (float(solved[l_w]), float(solved[r_w])), abs=1e-12
    )


def test_exchanged_poses_give_the_com_of_the_other():
    truth = total_com(ODD, ODD_LINKS, POSE_A.theta, POSE_A.theta)
    found = total_com_two_poses(POSE_B, POSE_A, ODD.m_2, FOOT)
    assert found == pytest.approx((truth.imag, truth.real), abs=1e-13)


@pytest.mark.parametrize("name", ["theta", "alpha", "beta", "r_u", "l_u", "U"])
def test_f_notices_one_wrong_sign_in_what_it_is_given(name):
    right = total_com_two_poses(POSE_A, POSE_B, ODD.m_2, FOOT)
    pose, foot = vars(POSE_B).copy(), vars(FOOT).copy()
    where = pose if name in pose else foot
    where[name] = -where[name]
    wrong = total_com_two_poses(POSE_A, TiltedLine(**pose), ODD.m_2, FootCad(**foot))
    assert max(abs(w - r) for w, r in zip(wrong, right, strict=True)) > 1e-4


def test_tilt_and_slope_that_cancel_are_refused():
    """A robot that leans as the floor does has not moved against gravity."""
    slope = math.tan(0.2)
    with pytest.raises(RankError, match="relative to gravity"):
        rest_com_two_poses(TiltedLine(0.0, 0.01), TiltedLine(0.2, 0.02, slope), ODD.m_2, FOOT)


def test_a_robot_that_is_all_feet_is_refused():
    with pytest.raises(RankError, match="no mass above"):
        rest_com_two_poses(POSE_A, POSE_B, FOOT.m_u, FOOT)


def test_coefficients_are_the_line_of_gravity_through_the_com():
    """Two random foot wrenches that hold a body on a slope, in the paper's own foot placement."""
    rng = np.random.default_rng(3)
    mass, half_stance = 23.0, 0.14
    com = np.array([0.03, -0.02, 0.41])
    gravity = mass * 9.81 * np.array([0.12, -0.07, -1.0])
    w_0 = rng.normal(size=6) * [20, 20, 5, 3, 3, 3] + [0, 0, 100, 0, 0, 0]
    point_0, point_1 = np.array([0, -half_stance, 0]), np.array([0, half_stance, 0])
    F_1 = -gravity - w_0[:3]
    about_p = -np.cross(com, gravity) - w_0[3:] - np.cross(point_0, w_0[:3])
    w_1 = np.concatenate([F_1, about_p - np.cross(point_1, F_1)])
    k = coefficients_as_published(w_0, w_1, half_stance)
    assert float(k.alpha + k.beta * com[2]) == pytest.approx(com[0], abs=1e-12)
    assert float(k.gamma + k.delta * com[2]) == pytest.approx(com[1], abs=1e-12)


def test_internal_torques_are_summed_about_the_axes_of_p():
    axes = [[1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]]
    assert internal_torques([[1.0, 2.0, 5.0, 7.0]], axes).tolist() == [[1.0, -3.0, 7.0]]


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_force_data_of_n_plus_1_shapes_have_rank_n_plus_1(n):
    """One joint bent at a time, on level ground; 2n poses with a twin of each determine all."""
    straight = np.zeros(n)
    bent = [np.where(np.arange(n) >= v, 0.35 + 0.05 * v, 0.0) for v in range(n)]
    masses = np.linspace(1.0, 2.0, n)
    published = np.array([straight, *bent])
    assert len(published) == n + 1
    assert np.linalg.matrix_rank(force_rows(published, masses)) == min(n + 1, 2 * n)
    twins = np.array([straight, *bent, *(pose + 0.3 for pose in bent[1:])])
    assert len(twins) == poses_required(n)
    assert np.linalg.matrix_rank(force_rows(twins, masses)) == 2 * n


def test_force_rows_are_the_moment_of_the_links():
    slope = 0.06
    pose = measured(ODD, ODD_LINKS, 0.2, -0.3, slope)
    row = force_rows([[0.2, -0.3]], [ODD.m_b, ODD.m_c], [pose.beta])
    foot, beta = ODD.foot, pose.beta
    known = foot.m_u * (foot.r_u - beta * foot.l_u) - beta * ODD.m_w * foot.U
    known += ODD.m_c * ODD.L_b * (math.sin(0.2) - beta * math.cos(0.2))
    total = float((row @ ODD_LINKS)[0]) + known
    assert total == pytest.approx(ODD.m_2 * pose.alpha, abs=1e-12)
