# SPDX-License-Identifier: Apache-2.0
"""Formula files: what is understood, what is refused and where, and that nothing in them is run."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.report.formula_check import formula_report_lines
from comcal.statics.published_chain import Bends
from comcal.statics.published_links import link_com_matrix
from comcal.symbolic.check_fault import FaultKind
from comcal.symbolic.check_points import Draw
from comcal.symbolic.check_quantities import QUANTITIES
from comcal.workflow.check_formula import check_formula

RIGHT = "m_w*r_wc = m_b*r_b + m_c*(l_c*sin(theta_c) + r_c*cos(theta_c))"


@pytest.fixture
def check(tmp_path):
    def run(quantity, formula, more=""):
        path = tmp_path / "f.yaml"
        head = f"format: comcal-formula/1\nquantity: {quantity}\n"
        path.write_text(f"{head}{more}formula: >-\n  {formula}\n", "utf-8")
        return check_formula(path)

    return run


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        ("m_b r_b", r"f.yaml:3: .*not a formula.*near 'm_b r_b'"),
        ("2(m_b)", r"f.yaml:3: .*no place in a formula"),
        ("m_b^2", r"powers are written \*\*"),
        ("m_b*r_d", r"symbol 'r_d' is not known; did you mean 'r_"),
        ("sine(theta_b)", r"function 'sine' is not known; did you mean 'sin'"),
        ("m_b(r_b)", r"write a \* before the bracket"),
        ("sin(theta_b, 2)", r"sin takes 1 argument"),
        ("a = b = c", r"symbol 'a' is not known|equals signs"),
        ("m_b = m_b = m_b", r"2 equals signs"),
        ("m_b*", r"not a formula"),
        ("= m_b", r"nothing on one side"),
        ("m_b if m_c else m_w", r"no place in a formula"),
        ("m_b < m_c", r"no place in a formula"),
        ("__import__('os').system('x')", r"no place in a formula"),
        ("(lambda: 1)()", r"no place in a formula"),
        ("m_b.real", r"no place in a formula"),
        ("[m_b][0]", r"no place in a formula"),
        ("'m_b'*2", r"not a number"),
        ("True*m_b", r"not a number"),
        ("2j*m_b", r"not a number"),
        ("1" + "0" * 400, r"not a number"),
        ("m_b % 2", r"not known"),
        ("(" * 3000 + "1" + ")" * 3000, r"nested too deeply|not a formula"),
        ("-" * 5000 + "1", r"nested too deeply|not a formula"),
        ("1 + " * 6000 + "1", r"too long|nested"),
        ("sqrt(0 - m_b)", r"no finite value"),
        ("m_b/(m_c - m_c)", r"no finite value"),
        ("m_w*r_wc", r"contains r_wc"),
        ("m_w*r_wc = r_wc*m_w", r"says nothing about moment_x_c"),
        ("m_b + m_c = m_w", r"says nothing about moment_x_c"),
    ],
)
def test_what_is_no_formula_is_refused_with_its_place(check, formula, message):
    with pytest.raises(ConfigError, match=message) as caught:
        check("moment_x_c", formula)
    assert str(caught.value).startswith("f.yaml:")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("quantity: r_b\n", "key 'format' is missing"),
        ("format: comcal-formula/1\nquantity: r_b\n", "give either `formula` or `matrix`"),
        ("format: comcal-formula/1\nquantity: r_d\nformula: a\n", "did you mean 'r_w'"),
        ("format: comcal-formula/1\nquantity: r_b\nformule: a\n", "f.yaml:3: .*'formula'"),
        ("format: comcal-formula/1\nquantity: r_b\nlinks: 3\nformula: m_b\n", "f.yaml:3: 'links'"),
        ("format: comcal-formula/1\nquantity: r_b\nover: m_b\nformula: m_b\n", "f.yaml:3: `over`"),
        ("format: comcal-formula/1\nquantity: r_b\nsymbols:\n  x: y\nformula: x\n", "f.yaml:4: "),
        (
            "format: comcal-formula/1\nquantity: moment_x\nconfiguration:\n  q_1: 0\nformula: 1\n",
            "f.yaml:4: 'q_1' is not the pitch of a link; possible are theta_1, theta_2",
        ),
        (
            "format: comcal-formula/1\nquantity: r_b\nmatrix:\n  - [m_b, 0]\n  - [0]\n",
            "wrong size .2 rows of 1 2, limit 4 rows of 4.",
        ),
        ("format: comcal-formula/1\nquantity: alpha\nmatrix:\n  - [1]\n", "is not a matrix"),
        ("format: comcal-formula/1\nquantity: link_com_rhs\nformula: 1\n", "is a matrix"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "f.yaml"
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=message):
        check_formula(path)


def test_names_of_the_reader_are_used_in_the_report(check):
    names = "symbols: {M: m_c, sθ: sin(theta_c), cθ: cos(theta_c), U: l_c}\n"
    report = check("moment_x_c", "m_b*r_b + M*(U*sθ - r_c*cθ)", names)
    assert report.wrong[0].fault.corrected == "m_b*r_b + M*(U*sθ + r_c*cθ)"
    report = check("moment_x_c", "m_b*r_b + M*(U*cθ + r_c*cθ)", names)
    assert (report.wrong[0].fault.term, report.wrong[0].fault.correct) == ("U*cθ", "U*sθ")


@pytest.mark.parametrize(
    ("quantity", "formula", "kind", "term", "correct"),
    [
        # E5: internal torques do not enter the balance.
        ("alpha", "-(M_Y0 + M_Y1 + M_Y2)/(F_Z0 + F_Z1)", FaultKind.EXTRA, "M_Y2", ""),
        ("gamma", "(M_X0 + M_X1)/(F_Z0 + F_Z1)", FaultKind.SEVERAL, "", "- l*F_Z0 + l*F_Z1"),
        ("beta", "-(F_X0 + F_X1)/(F_Z0 + F_Z1)", FaultKind.SIGN, None, None),
        ("delta", "(F_Y0 + F_X1)/(F_Z0 + F_Z1)", FaultKind.INDEX, "F_X1", "F_Y1"),
        ("det_A", "2*m_b**2*(1 - cos(theta_c))*m_c", FaultKind.EXPONENT, None, None),
        ("moment_x_c", "m_b*r_b + m_c*l_c*sin(theta_c) + r_c*cos(theta_c)", FaultKind.FACTOR,
         "r_c*cos(theta_c)", "r_c*cos(theta_c)*m_c"),
        ("det_A", "2*m_b**2*m_c**3*(1 - cos(theta_c))", FaultKind.EXPONENT, None, None),
        ("det_A", "m_b**2*m_c**2*(1 - cos(theta_c))", FaultKind.COEFFICIENT, None, None),
        ("det_A", "2*m_b**2*m_c**2*(1 + cos(theta_c))", FaultKind.SIGN, "+cos(theta_c)", None),
        ("moment_x_c", "2*(" + RIGHT[11:] + ")", FaultKind.COEFFICIENT, None, None),
        ("moment_x_c", "-m_b*r_b - m_c*(l_c*sin(theta_c) + r_c*cos(theta_c))",
         FaultKind.SIGN, None, None),
        ("moment_x", "m_1*(l_1*sin(q_1) + r_1*cos(q_1)) + m_2*(L_1*sin(q_1) + l_2*sin(q_1)"
         " + r_2*cos(q_1 + q_2))", FaultKind.INDEX, "l_2*sin(q_1)", "l_2*sin(theta_2)"),
        ("moment_x", "m_1*(l_1*sin(q_1) + r_1*cos(q_1)) + m_2*(L_1*sin(q_1) + l_2*sin(q_1 - q_2)"
         " + r_2*cos(q_1 + q_2))", FaultKind.SIGN, "-q_2", "+q_2"),
        ("moment_x_c", "m_b*r_b", FaultKind.SEVERAL, "", None),
    ],
)  # fmt: skip
def test_each_kind_of_fault_is_named(check, quantity, formula, kind, term, correct):
    report = check(quantity, formula)
    fault = report.wrong[0].fault
    assert fault is not None
    assert fault.kind is kind
    assert term is None or fault.term == term
    assert correct is None or fault.correct == correct
    assert check(quantity, fault.corrected).agrees


@pytest.mark.parametrize("right", ["0", "m_b*r_b"])
def test_a_correction_is_never_the_quantity_itself_brought_over(check, right):
    fault = check("moment_x_c", f"m_w*r_wc = {right}").wrong[0].fault
    assert fault is not None
    assert check("moment_x_c", fault.corrected).agrees


def test_what_no_single_term_explains_is_said_with_its_size(check):
    report = check("moment_x_c", "m_b*r_b*exp(theta_c) + m_c*l_c*tan(theta_b)")
    assert report.wrong[0].fault is None
    text = "\n".join(formula_report_lines(report))
    assert "no change of a single term makes it agree" in text
    assert "right at 0 % of the points" in text


def test_the_same_file_gives_the_same_report(check):
    wrong = RIGHT.replace("+ r_c", "- r_c")
    assert check("moment_x_c", wrong) == check("moment_x_c", wrong)


def test_the_matrix_at_the_points_is_the_corrected_published_one():
    quantity = QUANTITIES["link_com_matrix"]
    values = quantity.points(Draw(np.random.default_rng(1), 7, linked=True), 2).values
    ours = quantity.value(values)
    for i in range(7):
        bends = Bends(float(values["theta_b"][i]), float(values["theta_c"][i]))
        theirs = link_com_matrix(bends, float(values["m_b"][i]), float(values["m_c"][i]))
        np.testing.assert_allclose(ours[..., i], theirs, atol=1e-14)
