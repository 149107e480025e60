# SPDX-License-Identifier: Apache-2.0
"""A right formula is right however it is written: no false alarm."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from comcal.symbolic.check import check_claim
from comcal.symbolic.check_claim import Claim, Line
from comcal.symbolic.check_quantities import QUANTITIES

RIGHT_B = (
    "m_b*(l_b*sin(theta_b) + r_b*cos(theta_b)) + m_c*((L_b + l_c)*sin(theta_b) + r_c*cos(theta_b))"
)
RIGHT_C = "m_b*(L_a + l_b) + m_c*(L_a + L_b + l_c*cos(theta_c) - r_c*sin(theta_c))"
CHAIN = (
    "m_1*(l_1*sin(q_1) + r_1*cos(q_1)) + m_2*(L_1*sin(q_1) + l_2*sin(q_1 + q_2)"
    " + r_2*cos(q_1 + q_2)) + m_3*(L_1*sin(q_1) + L_2*sin(q_1 + q_2)"
    " + l_3*sin(q_1 + q_2 + q_3) + r_3*cos(q_1 + q_2 + q_3))"
)
REWRITINGS = {
    "expand": sp.expand,
    "factor": sp.factor,
    "expand_trig": lambda e: sp.expand(sp.expand_trig(e)),
    "collect": lambda e: sp.collect(sp.expand(e), list(e.atoms(sp.sin, sp.cos))),
    "sin as cos": lambda e: e.rewrite(sp.cos),
    "tan of the half": lambda e: e.rewrite(sp.tan),
    "exact": lambda e: e.subs(sp.Symbol("m_w"), sp.Symbol("m_b") + sp.Symbol("m_c")),
    "halved": lambda e: sp.expand(e / 2) * 2,
    "one added": lambda e: e * (sp.sin(sp.Symbol("m_u")) ** 2 + sp.cos(sp.Symbol("m_u")) ** 2),
}


def report_on(name, text, **more):
    return check_claim(Claim(QUANTITIES[name], formula=Line(text, "f:1"), **more))


@pytest.mark.parametrize("rewriting", REWRITINGS.values(), ids=REWRITINGS)
@pytest.mark.parametrize(
    ("name", "text"), [("moment_x_b", RIGHT_B), ("moment_z_c", RIGHT_C), ("moment_x", CHAIN)]
)
def test_a_rewritten_formula_agrees(name, text, rewriting):
    new = str(rewriting(sp.sympify(text)))
    assert report_on(name, new, links=3).agrees, new


@pytest.mark.parametrize("seed", range(5))
def test_the_order_of_terms_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    terms = [str(t) for t in sp.Add.make_args(sp.expand(sp.sympify(CHAIN)))]
    text = " + ".join(f"({terms[i]})" for i in rng.permutation(len(terms)))
    assert report_on("moment_x", text, links=3).agrees


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("moment_x_b", "r_wb = (m_b*l_b + m_c*(L_b + l_c))/(m_b + m_c)*sin(theta_b)"
         " + (m_b*r_b + m_c*r_c)*cos(theta_b)/(m_2 - m_u)"),
        ("moment_x_b", "X_2b*m_2 - m_u*r_u - m_w*r_wb = 0"),
        ("moment_z_b", "Eq"),
        ("det_A", "2*m_b**2*m_c**2*(1 - cos(theta_c))"),
        ("det_A", "4*m_b**2*m_c**2*sin(theta_c/2)**2"),
        ("det_A", "m_b**2*m_c**2*((1 - cos(theta_c))**2 + sin(theta_c)**2)"),
        ("l_c", "(r_b*0 + a_4 - m_b*l_b + m_c*r_c*sin(theta_c))/(m_c*cos(theta_c))"),
        ("alpha", "-(M_Y0 + M_Y1)/(F_Z0 + F_Z1)"),
        ("gamma", "(M_X0 + M_X1 + l*(F_Z1 - F_Z0))/(F_Z0 + F_Z1)"),
        ("beta", "(F_X0 + F_X1)/(F_Z0 + F_Z1)"),
        ("delta", "(F_Y0 + F_Y1)/(F_Z0 + F_Z1)"),
        ("Z_2B", "(m_u*l_u + m_w*(U + l_w*cos(theta_t) - r_w*sin(theta_t)))/m_2"),
        ("Z_2B", "(X_2B - alpha_B)/beta_B"),
    ],
)  # fmt: skip
def test_formulas_in_use_agree(name, text):
    if text == "Eq":
        text = "m_w*(l_wb + L_a) = (m_b + m_c)*L_a + (m_b*l_b + m_c*(L_b + l_c))*cos(theta_b) - " \
            "sin(theta_b)*(m_b*r_b + m_c*r_c)"  # fmt: skip
    assert report_on(name, text).agrees


def test_total_com_from_two_poses_agrees():
    """(19), solved by sympy from (14), (16), (17)."""
    x_a, x_b, l_w, r_w, m_w, m_2 = sp.symbols("alpha_A alpha_B l_w r_w m_w m_2")
    beta_a, beta_b, m_u, l_u, r_u, U, t = sp.symbols("beta_A beta_B m_u l_u r_u U theta_t")
    equations = [
        m_u * r_u + m_w * (l_w * sp.sin(i) + r_w * sp.cos(i))
        - a * m_2 - b * (m_u * l_u + m_w * (U + l_w * sp.cos(i) - r_w * sp.sin(i)))
        for a, b, i in ((x_a, beta_a, sp.Integer(0)), (x_b, beta_b, t))
    ]  # fmt: skip
    found = sp.solve(equations, [l_w, r_w], dict=True)[0]
    for name, height in (
        ("Z_2A", found[l_w]),
        ("Z_2B", found[l_w] * sp.cos(t) - found[r_w] * sp.sin(t)),
    ):
        text = str((m_u * l_u + m_w * (U + height)) / m_2)
        assert report_on(name, text).agrees
        assert not report_on(name, text.replace("beta_A", "beta_B", 1)).agrees


def test_a_matrix_with_rows_exchanged_and_scaled_is_a_rewriting():
    rows = [
        ["a_3", "0", "m_c*cos(theta_c)", "m_c*sin(theta_c)"],
        ["-2*a_4", "-2*m_b", "2*m_c*sin(theta_c)", "-2*m_c*cos(theta_c)"],
        ["a_1", "m_b*sin(theta_b)", "m_c*cos(theta_b)", "m_c*sin(theta_b)"],
        ["a_2", "m_b*cos(theta_b)", "-m_c*sin(theta_b)", "m_c*cos(theta_b)"],
    ]
    matrix = [[Line(text, "f:1") for text in row] for row in rows]
    right = check_claim(Claim(QUANTITIES["r_b"], matrix=matrix, over=Line("-2*det_A", "f:9")))
    assert right.agrees
    assert right.rewritten
    matrix[0][2] = Line("-m_c*cos(theta_c)", "f:1")
    wrong = check_claim(Claim(QUANTITIES["r_b"], matrix=matrix, over=Line("-2*det_A", "f:9")))
    assert not wrong.agrees


@pytest.mark.parametrize(("links", "seed"), [(1, 0), (2, 1), (5, 2), (8, 3)])
def test_a_chain_of_any_length_is_that_of_real_trigonometry(links, seed):
    x = "+".join(
        f"m_{v}*({''.join(f'L_{u}*sin(theta_{u}) + ' for u in range(1, v))}"
        f"l_{v}*sin(theta_{v}) + r_{v}*cos(theta_{v}))"
        for v in range(1, links + 1)
    )
    assert report_on("moment_x", x, links=links).agrees
    wrong = f"r_{1 + seed % links}*cos"
    assert not report_on("moment_x", x.replace(wrong, f"2*{wrong}"), links=links).agrees


def test_a_configuration_gives_angles_special_values():
    bent = {name: Line(text, "f:1") for name, text in
            {"theta_1": "0", "theta_3": "theta_2"}.items()}  # fmt: skip
    text = "m_1*r_1 + m_2*(l_2*sin(theta_2) + r_2*cos(theta_2)) + m_3*((L_2 + l_3)*sin(theta_2)"
    text += " + r_3*cos(theta_2))"
    assert report_on("moment_x", text, links=3, configuration=bent).agrees
    assert not report_on("moment_x", text, links=3).agrees
