# SPDX-License-Identifier: Apache-2.0
"""Equations of Muscolo et al. (2017), as printed, checked: what is wrong, and only that.

``muscolo_equations`` holds (10)-(13) and (34)-(43). E5 is M_2 in (10) and (12); E1 is the sign in
(36) and in row 3 of (38), which (40), (41) and (43) repeat; E2 is the last entry of (40)-(42).
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from comcal.report.formula_check import formula_report_lines
from comcal.symbolic.check_fault import FaultKind
from comcal.workflow.check_formula import check_formula

EQUATIONS = Path(__file__).parent / "muscolo_equations"
E1 = ((3, 3), FaultKind.SIGN, "-m_c*c_c", "+m_c*c_c")
E2 = ((4, 4), FaultKind.SINE_COSINE, "m_c*s_c", "m_c*c_c")
FAULTS = {
    10: [(None, FaultKind.EXTRA, "M_Y2", "")],
    11: [],
    12: [(None, FaultKind.EXTRA, "M_X2", "")],
    13: [],
    34: [],
    35: [],
    36: [(None, FaultKind.SIGN, "-r_c*cos(theta_c)", "+r_c*cos(theta_c)")],
    37: [],
    38: [E1],
    39: [],
    40: [E1, E2],
    41: [E1, E2],
    42: [E2],
    43: [E1],
}


@pytest.mark.parametrize("equation", FAULTS)
def test_the_printed_equation_has_these_faults_and_no_other(equation):
    report = check_formula(EQUATIONS / f"equation_{equation}.yaml")
    assert report.quantity.equation == f"({equation})"
    found = [
        (entry.place, entry.fault.kind, entry.fault.term, entry.fault.correct)
        for entry in report.wrong
        if entry.fault is not None
    ]
    assert found == FAULTS[equation]
    assert len(report.wrong) == len(found)
    assert report.agrees == (not found)


@pytest.mark.parametrize("equation", [n for n, faults in FAULTS.items() if faults])
def test_with_the_faults_put_right_the_equation_agrees(equation, tmp_path):
    text = (EQUATIONS / f"equation_{equation}.yaml").read_text("utf-8")
    text = text.replace("- r_c*cos(theta_c)", "+ r_c*cos(theta_c)").replace("-m_c*c_c", "m_c*c_c")
    text = text.replace(" + M_Y2", "").replace(" + M_X2", "")
    lines = text.splitlines()
    if equation in {40, 41, 42}:
        last = next(i for i, line in enumerate(lines) if "a_4" in line)
        lines[last] = lines[last].replace("m_c*s_c]", "m_c*c_c]")
    path = tmp_path / "corrected.yaml"
    path.write_text("\n".join(lines), "utf-8")
    assert check_formula(path).agrees


def test_the_text_of_a_report():
    report = check_formula(EQUATIONS / "equation_36.yaml")
    assert formula_report_lines(report) == [
        "moment_x_c: first moment about P along x of what is above the ankles in pose c [kg m], "
        "Muscolo 2017 (36)",
        "does NOT agree with the moment balance at 300 random points",
        "  equation_36.yaml:4: wrong sign: -r_c*cos(theta_c), in m_c*(l_c*sin(theta_c) - "
        "r_c*cos(theta_c)); with +r_c*cos(theta_c) the rest agrees",
        "    corrected: m_w*r_wc = m_b*r_b + m_c*(l_c*sin(theta_c) + r_c*cos(theta_c))",
    ]
    matrix = formula_report_lines(check_formula(EQUATIONS / "equation_40.yaml"))
    assert matrix[2:] == [
        "  row 3, column 3, equation_40.yaml:12: wrong sign: -m_c*c_c; with +m_c*c_c the rest "
        "agrees",
        "  row 4, column 4, equation_40.yaml:13: sine and cosine exchanged: m_c*s_c; with m_c*c_c "
        "the rest agrees",
    ]


def said(equation: int) -> str:
    """What ``--check`` prints about an equation, but for file and line."""
    _, verdict, *more = formula_report_lines(check_formula(EQUATIONS / f"equation_{equation}.yaml"))
    found = [line.strip() for line in more if "corrected:" not in line]
    where = r"(, )?equation_\d+\.yaml:\d+"
    lines = [re.sub(where, "", line).removeprefix(": ") for line in found]
    return "<br>".join(f"`{line}`" for line in lines) or verdict


def test_the_table_of_findings_in_the_readme_is_what_the_program_says(root):
    text = (root / "README.md").read_text("utf-8")
    rows = re.findall(r"^\| \((\d+)\) \| (.*?) \| (.*?) ?\|$", text, flags=re.M)
    short = {FaultKind.SIGN: "E1", FaultKind.SINE_COSINE: "E2", FaultKind.EXTRA: "E5"}
    named = {n: ", ".join(short[kind] for _, kind, *_ in FAULTS[n]) for n in FAULTS}
    assert rows == [(str(n), said(n), named[n]) for n in FAULTS]
