# SPDX-License-Identifier: Apache-2.0
"""What the report says of numbers that are missing, or that rest on the URDF."""

import io
from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.calibration import Method, calibrate
from comcal.report.calibration import print_calibration
from comcal.report.console import make_console
from comcal.robot.model import Limits
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of


def text_of(calibration):
    stream = io.StringIO()
    print_calibration(make_console(file=stream), calibration)
    return " ".join(stream.getvalue().split())


def test_limits_that_were_not_judged_are_not_called_unset(table1):
    table = table1.noisy(table1.measure(), np.random.default_rng(1))
    assert table1.robot.limits != Limits()
    by_cramer = text_of(calibrate(table1.robot, table, Method.CRAMER))
    assert "NO LIMITS JUDGED: limits are judged by the all-data route" in by_cramer
    unset = replace(table1.robot, limits=Limits())
    assert "NO LIMITS SET" in text_of(calibrate(unset, table, Method.CRAMER))


def test_held_out_poses_that_leaned_on_the_urdf_are_said(table1):
    plan = [*table1.plan, replace(table1.plan[0], pose=99, floor_pitch=0.05)]
    table = table1.noisy(table1.measure(plan), np.random.default_rng(2))
    words = "1 time(s) the poses left out were the only ones of their kind"
    assert words in text_of(calibrate(table1.robot, table))
    assert words not in text_of(calibrate(table1.robot, table.select(range(len(table1.plan)))))


@pytest.mark.parametrize("var", [1e-8, np.nan])
def test_a_component_that_is_not_given_is_printed_as_a_dash(var, table1):
    table = table1.measure(table1.plan[:5:2])
    at = placed_in_stance(table1.robot, carrier_of(table1.robot, "double"), table.q)
    com = at.total_com()
    com[:, 1] = np.nan
    empty = {s: np.full_like(w, np.nan) for s, w in table.wrench.items()}
    given = replace(table, com=com, com_var=np.full((3, 3), var), wrench=empty)
    text = text_of(calibrate(table1.robot, given))
    assert "nan" not in text.lower()
    assert " given - " in text
