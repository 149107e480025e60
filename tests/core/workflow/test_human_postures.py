# SPDX-License-Identifier: Apache-2.0
"""The whole way from a pose table of a bare chain to predictions and a verdict."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from comcal.errors import ConfigError, MissingColumnError, UsageError
from comcal.identify.postures import Usability
from comcal.measure.poses_csv import read_poses
from comcal.measure.table import PoseTable
from comcal.report.postures import postures_lines
from comcal.report.postures_json import postures_json
from comcal.robot.description import load_robot
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.workflow.human_postures import solve_postures

ROBOT = """\
format: comcal-robot/1
name: two bodies
base: fixed
chain:
  - {name: lower, axis: y}
  - {name: upper, parent: lower, axis: y}
"""
CONVENTIONS = """\
format: comcal-conventions/1
orders: {as printed: [lower, upper], exchanged: [upper, lower]}
signs: [upper]
offset: [zero]
rounding: {angle: 0.1 deg, length: 0.1 mm}
"""
R = np.array([0.02, 0.6, 0.01, 0.25])
Session = Callable[..., tuple[Robot, PoseTable]]


def com_x(q: Array) -> Array:
    """CoM of the true chain: the upper joint turns against the stated sense."""
    a, b = q[:, 0], q[:, 0] - q[:, 1]
    return R[0] * np.cos(a) + R[1] * np.sin(a) + R[2] * np.cos(b) + R[3] * np.sin(b)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    def make(n: int = 16, noise: float = 1e-4, frame: str = "base", conventions: bool = True):
        rng = np.random.default_rng(n)
        q = rng.uniform(-1.0, 1.0, (n, 2))
        x = com_x(q) + rng.normal(0, noise, n)
        lines = ["pose,support,q.lower,q.upper,com.x,com.frame"]
        lines += [f"{i + 1},none,{q[i, 0]:.9f},{q[i, 1]:.9f},{x[i]:.9f},{frame}" for i in range(n)]
        (tmp_path / "robot.yaml").write_text(ROBOT, encoding="utf-8")
        (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        if conventions:
            (tmp_path / "conventions.yaml").write_text(CONVENTIONS, encoding="utf-8")
        robot = load_robot(tmp_path / "robot.yaml")
        return robot, read_poses(tmp_path / "poses.csv", robot)

    return make


def test_true_reading_is_found_and_held_out_poses_are_predicted(session: Session) -> None:
    result = solve_postures(*session(), held_out=[3, 7, 11], draws=20)

    chosen = result.ranking.chosen.convention
    assert (chosen.order, chosen.signs) == ("as printed", (1, -1))
    assert result.fit.unknowns == 4
    assert result.fit.dof == 13 - 4
    assert [p.pose for p in result.predictions] == [3, 7, 11]
    assert all(p.is_inside and p.half_width < 0.01 for p in result.predictions)
    assert result.usability is Usability.USABLE
    assert result.verdict == "usable"


def test_held_out_measurements_enter_nothing_but_the_comparison(session: Session) -> None:
    robot, table = session(8, 0.01)
    held = np.isin(table.pose, [2, 5])
    forged = table.com.copy()
    forged[held, 0] += [3.0, -40.0]

    honest = solve_postures(robot, table, held_out=[2, 5], draws=20)
    fooled = solve_postures(robot, replace(table, com=forged), held_out=[2, 5], draws=20)

    # As text: what does not apply is NaN, which equals nothing.
    assert repr(honest.ranking) == repr(fooled.ranking)
    np.testing.assert_array_equal(honest.fit.r, fooled.fit.r)
    assert honest.com_spread == fooled.com_spread
    assert honest.reasons == fooled.reasons
    for a, b, moved in zip(honest.predictions, fooled.predictions, (3.0, -40.0), strict=True):
        assert replace(a, measured=0.0) == replace(b, measured=0.0)
        assert b.measured - a.measured == pytest.approx(moved)


def test_the_same_seed_gives_the_same_result(session: Session) -> None:
    robot, table = session(9, 0.01)
    lines = [
        postures_lines(solve_postures(robot, table, held_out=[1], seed=seed, draws=20))
        for seed in (4, 4, 5)
    ]

    assert lines[0] == lines[1]
    assert lines[0] != lines[2]


def test_few_poses_are_called_hardly_usable(session: Session) -> None:
    result = solve_postures(*session(8, 0.01), held_out=[1, 2], draws=20)

    assert result.usability is Usability.HARDLY_USABLE
    assert "6 poses for 4 unknowns leave 2 degrees of freedom" in result.verdict


def test_without_conventions_file_the_chain_is_taken_as_stated(session: Session) -> None:
    result = solve_postures(*session(conventions=False), held_out=[1], draws=5)

    assert result.ranking.n_candidates == 1
    assert result.ranking.chosen.convention.order == "as stated"
    assert not result.predictions[0].is_inside or result.predictions[0].half_width > 0.05


def test_report_prints_every_interval_spread_and_error(session: Session) -> None:
    result = solve_postures(*session(8, 0.01), held_out=[1, 2], draws=20)

    text = "\n".join(postures_lines(result))

    for p in result.predictions:
        row = next(line for line in text.splitlines() if line.startswith(f"  {p.pose:>4} x"))
        for length in (p.predicted, p.half_width, *p.rounding, *p.conventions, p.error):
            assert f"{1e3 * length:.1f}" in row
    assert "lower = +" in text
    assert f"{result.fit.dof} degrees of freedom" in text
    assert "Verdict: hardly usable" in text
    assert "seed 0" in text


def test_json_holds_numbers_that_json_can_hold(session: Session) -> None:
    data = postures_json(solve_postures(*session(8, 0.01), held_out=[1, 2], draws=20))

    again = json.loads(json.dumps(data, allow_nan=False))

    assert again["verdict"] == "not_identifiable"
    assert again["dof"] == 2
    assert [p["pose"] for p in again["held_out"]["poses"]] == [1, 2]


def test_fit_without_held_out_poses_reports_leave_one_out_only(session: Session) -> None:
    result = solve_postures(*session(), draws=10)

    assert result.predictions == ()
    assert "Held-out" not in "\n".join(postures_lines(result))
    assert postures_json(result)["held_out"]["com_rms_mm"] is None


def test_unknown_held_out_pose_is_refused_with_the_poses_there_are(session: Session) -> None:
    with pytest.raises(UsageError, match=r"no pose 99 to hold out; the poses are 1, 2, 3"):
        solve_postures(*session(5), held_out=[1, 99])


def test_holding_out_every_pose_is_refused(session: Session) -> None:
    with pytest.raises(UsageError, match="none is left"):
        solve_postures(*session(4), held_out=[1, 2, 3, 4])


def test_com_in_the_frame_of_a_moving_link_is_refused(session: Session) -> None:
    with pytest.raises(ConfigError, match="upper_link"):
        solve_postures(*session(frame="upper_link"))


def test_pose_without_com_is_refused_with_its_line(session: Session) -> None:
    robot, table = session()
    com = table.com.copy()
    com[4] = np.nan
    with pytest.raises(MissingColumnError, match=r"poses.csv:6 \(pose 5\)"):
        solve_postures(robot, replace(table, com=com))
