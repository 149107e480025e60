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
