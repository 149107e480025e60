# SPDX-License-Identifier: Apache-2.0
"""The nineteen human postures of Cotton 2009: what fourteen of them say about the other five.

Golden are the choice, the counting and the honesty of the report. Agreement with Table II of the
paper is not tested, because it is not claimed.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.identify.postures import PosturesResult, Usability
from comcal.measure.importer import import_csv
from comcal.measure.poses_csv import read_poses
from comcal.measure.table import PoseTable
from comcal.report.postures import postures_lines
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.workflow.human_postures import solve_postures

HERE = Path(__file__).parent / "cotton2009"
HELD_OUT = (4, 7, 8, 14, 15)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, PoseTable]:
    """Import the table, then put what it may mean beside the session's robot.yaml."""
    folder = tmp_path_factory.mktemp("cotton2009") / "session"
    imported = import_csv(HERE / "table1.csv", HERE / "map.yaml", folder)
    shutil.copy(HERE / "conventions.yaml", folder)
    robot = load_robot(imported.session.robot_yaml)
    return robot, read_poses(imported.session.poses_csv, robot)


@pytest.fixture(scope="module")
def result(session: tuple[Robot, PoseTable]) -> PosturesResult:
    return solve_postures(*session, held_out=HELD_OUT)


def test_table_is_the_published_one(session: tuple[Robot, PoseTable]) -> None:
    _, table = session
    assert table.pose == tuple(range(1, 20))
    np.testing.assert_allclose(
        np.degrees(table.q[[0, 16, 18]]),
        [[0, 0, 0, 0, -87, 90], [10, -27, -25, -8, -92, 36], [-4, -14, 4, -24, -109, 22]],
        atol=1e-9,
    )
    assert 1e3 * table.com[:, 0].sum() == pytest.approx(836.0)
    assert np.isnan(table.com[:, 1:]).all()


def test_fourteen_poses_leave_one_or_two_degrees_of_freedom(result: PosturesResult) -> None:
    counts = {(s.convention.offset.value, s.unknowns, s.dof) for s in result.ranking.scored}

    assert counts == {("zero", 12, 2), ("unknown", 13, 1)}
    assert len(result.fitted) == 14
    assert not set(result.fitted) & set(HELD_OUT)
    assert result.fit.dof == result.ranking.chosen.dof


def test_the_reading_chosen_by_the_fourteen_is_named(result: PosturesResult) -> None:
    chosen = result.ranking.chosen.convention

    assert chosen.order == "leg by leg (ankle hip ankle hip)"
    assert chosen.signs == (1, -1, -1, 1, -1, 1)
    text = "\n".join(postures_lines(result))
    assert "theta3 = + ankle of the other foot" in text
    assert "theta2 = - hip of the first leg" in text


def test_the_two_foot_poses_refute_no_reading(result: PosturesResult) -> None:
    """Angles of poses 1 and 5 are so small that every reading nearly closes the loop."""
    assert result.ranking.two_feet == (1, 5)
    assert not result.ranking.closure_separates
    assert max(np.degrees(s.gap_rms) for s in result.ranking.scored) < 5.0


def test_a_quarter_of_all_readings_cannot_be_told_from_the_best(result: PosturesResult) -> None:
    share = len(result.ranking.tied) / len(result.ranking.scored)

    assert len(result.ranking.scored) == 384
    assert 0.2 < share < 0.5
    assert len({s.convention.order for s in result.ranking.tied}) == 6


def test_luck_is_not_taken_for_accuracy(result: PosturesResult) -> None:
    """Some readings leave out any pose to within 10 mm, but not once the table is rounded anew."""
    lucky = [s for s in result.ranking.scored if s.left_out_rms < 0.01]

    assert len(lucky) > 3
    assert all(s.left_out_median > 0.012 for s in lucky)


def test_verdict_is_hardly_usable(result: PosturesResult) -> None:
    assert result.usability is Usability.HARDLY_USABLE
    assert "14 poses for 12 unknowns leave 2 degrees of freedom" in result.verdict
    assert "cannot be told apart" in result.verdict
    # Wider than the error of guessing the mean of the fitted poses for every pose.
    assert min(result.half_widths) > result.com_spread == pytest.approx(0.058, abs=0.001)


def test_report_shows_each_interval_and_both_spreads(result: PosturesResult) -> None:
    lines = postures_lines(result)

    for p in result.predictions:
        row = next(line for line in lines if line.startswith(f"  {p.pose:>4} x"))
        ends = (*p.rounding, *p.conventions)
        for length in (p.predicted, p.half_width, *ends, p.measured, p.error):
            assert f"{1e3 * length:.1f}" in row
        assert p.half_width > 0.1
        assert p.rounding[0] < p.rounding[1]
        assert p.conventions[1] - p.conventions[0] > 0.1
        assert p.conventions[0] <= p.predicted <= p.conventions[1]
    assert [p.pose for p in result.predictions] == list(HELD_OUT)
    assert any(line.startswith("Verdict: hardly usable") for line in lines)


def test_intervals_hold_what_was_measured(result: PosturesResult) -> None:
    """95 % of them should; that they are wide is the point of the verdict."""
    assert sum(p.is_inside for p in result.predictions) >= 4
    assert np.isfinite(result.held_out_rms)


def test_held_out_measurements_do_not_touch_the_choice(session: tuple[Robot, PoseTable]) -> None:
    robot, table = session
    com = table.com.copy()
    com[np.isin(table.pose, HELD_OUT), 0] = 0.5

    honest, forged = (
        solve_postures(robot, data, held_out=HELD_OUT, draws=20)
        for data in (table, replace(table, com=com))
    )

    assert forged.ranking == honest.ranking
    np.testing.assert_array_equal(forged.fit.r, honest.fit.r)
    assert [replace(p, measured=0.0) for p in forged.predictions] == [
        replace(p, measured=0.0) for p in honest.predictions
    ]
    assert {p.measured for p in forged.predictions} == {0.5}
