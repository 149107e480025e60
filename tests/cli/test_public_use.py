# SPDX-License-Identifier: Apache-2.0
"""The public functions, used as somebody's own script would use them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import comcal
from comcal.cli.main import main
from comcal_sims.robots import table1


def test_a_script_gets_from_a_session_to_link_coms(tmp_path: Path) -> None:
    robot_yaml = table1.generate(tmp_path / "robot")
    options = ["--source", "builtin", "--seed", "1", "--no-noise"]
    assert main(["record", str(robot_yaml), "-s", str(tmp_path / "monday"), *options]) == 0

    session, robot, table = comcal.load_session(tmp_path / "monday")
    assert session.poses_csv.is_file()
    coefficients = comcal.balance_coefficients(robot, table)
    assert coefficients.values.shape == (25, 4)
    links = comcal.link_coms(robot, table)
    np.testing.assert_allclose(links.choices[0].w, [0.2, 0.32208589], atol=1e-6)
    solution = comcal.identify_links(robot, table)
    assert solution.mass == pytest.approx(18.6, abs=1e-6)
    assert comcal.calibrate(robot, table).verdict.value == "passed"


def test_a_script_derives_formulas_and_runs_them() -> None:
    program = comcal.derive(comcal.DeriveOrder(comcal.DeriveWhat.LINK_COM, dof=2))
    link_coms = comcal.python_function(program)
    w, theta = np.array([0.2 + 0.01j, 0.3 - 0.02j]), np.array([0.1, 0.5])
    turn = np.exp(1j * np.array([[theta[0], theta[0]], [0.0, theta[1]]]))
    com = (turn[:, 0] * (w[0] + 0.4) + turn[:, 1] * w[1]) / 2
    given = {"m": [1, 1], "L": [0.4], "m_u": 0, "r_u": 0, "l_u": 0, "U": 0}
    r, along, _ = link_coms(X=com.imag, Z=com.real, theta=theta, **given)
    np.testing.assert_allclose(along + 1j * r, w, atol=1e-14)
    for text in (comcal.to_c(program), comcal.to_latex(program), comcal.to_text(program)):
        assert "theta" in text


def test_a_script_checks_a_formula_written_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "equation.yaml"
    path.write_text("format: comcal-formula/1\nquantity: beta\nformula: F_X0/F_Z0\n")
    assert not comcal.check_formula(path).agrees
    path.write_text(path.read_text().replace("F_X0/F_Z0", "(F_X0 + F_X1)/(F_Z0 + F_Z1)"))
    assert comcal.check_formula(path).agrees
