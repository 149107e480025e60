# SPDX-License-Identifier: Apache-2.0
"""Plans in which every pose stands twice, and the direction in which joints travelled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from comcal.errors import UsageError
from comcal.measure.both_sides import both_sides
from comcal.measure.plan import PlannedPose
from comcal.measure.plan_csv import read_plan, write_plan
from comcal.measure.pose_row import approaches
from comcal.measure.travel import REVERSAL, Travel

JOINTS = ("hip", "knee", "ankle")
ANGLES = arrays(np.float64, 3, elements=st.sampled_from([-0.4, 0.0, 0.1, 0.3]))


def plan_of(*q: object) -> tuple[PlannedPose, ...]:
    return tuple(PlannedPose(i, np.array(x, dtype=np.float64)) for i, x in enumerate(q, start=1))


@settings(deadline=None, max_examples=50)
@given(st.lists(ANGLES, min_size=1, max_size=6))
def test_joints_that_moved_come_from_opposite_sides_the_first_time_naturally(
    positions: list[np.ndarray],
) -> None:
    plan = plan_of(*positions)
    twice = both_sides(plan, JOINTS)
    assert [p.pose for p in twice] == [i for p in plan for i in (2 * p.pose, 2 * p.pose + 1)]
    before: PlannedPose | None = None
    for pose, first, second in zip(plan, twice[::2], twice[1::2], strict=True):
        assert first.revisit == second.revisit == f"pose {pose.pose}"
        np.testing.assert_array_equal(first.q, second.q)
        natural = approaches(first, before, JOINTS)
        other = approaches(second, first, JOINTS)
        for k, joint in enumerate(JOINTS):
            step = pose.q[k] - (0.0 if before is None else before.q[k])
            if before is not None and step == 0.0:
                assert natural[joint] == other[joint] == 0
            else:
                assert natural[joint] == (np.sign(step) or 1)
                assert other[joint] == -natural[joint]
        before = second


def test_what_the_plan_demands_comes_first() -> None:
    pose = PlannedPose(4, np.array([0.1, 0.1, 0.0]), approach={"hip": -1, "knee": 0}, revisit="a")
    first, second = both_sides((pose,), JOINTS)
    assert first.approach == {"hip": -1, "knee": 0, "ankle": 1}
    assert second.approach == {"hip": 1, "knee": 0, "ankle": -1}
    assert first.revisit == second.revisit == "a"


def test_negative_ids_are_refused() -> None:
    with pytest.raises(UsageError, match="zero or more"):
        both_sides((PlannedPose(-1, np.zeros(3)),), JOINTS)


def test_a_plan_approached_twice_survives_its_file(tmp_path: Path) -> None:
    twice = both_sides(plan_of([0.0, 0.1, 0.2], [0.3, 0.1, 0.0]), JOINTS)
    write_plan(tmp_path / "plan.csv", twice, JOINTS)
    for wrote, read in zip(twice, read_plan(tmp_path / "plan.csv", JOINTS), strict=True):
        assert (wrote.pose, wrote.revisit) == (read.pose, read.revisit)
        assert {j: s for j, s in read.approach.items() if s} == wrote.approach


def followed(*values: float) -> list[int]:
    """Return the side after each value of one joint."""
    travel = Travel(1)
    sides: list[int] = []
    for value in values:
        travel.follow(np.array([[value]]))
        sides.append(int(travel.sides[0]))
    return sides


def test_a_side_is_the_direction_of_the_last_way_that_counts() -> None:
    r = REVERSAL
    assert followed(0.0, 0.4 * r, -0.4 * r) == [0, 0, 0]  # noise
    assert followed(0.0, 5 * r, 4.5 * r, 3 * r, 3.5 * r, 6 * r) == [0, 1, 1, -1, -1, 1]
    assert followed(0.0, -5 * r, 0.0, -0.5 * r, -1.1 * r) == [0, -1, 1, 1, -1]


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=30))
def test_sides_turn_round_with_the_axis(values: list[float]) -> None:
    assert followed(*(-x for x in values)) == [-side for side in followed(*values)]


def test_a_new_beginning_forgets_the_way() -> None:
    travel = Travel(1)
    travel.follow(np.array([[0.0], [1.0], [2.0], [3.0]]))
    assert travel.sides.tolist() == [1]
    travel.begin()
    travel.follow(np.array([[3.0], [np.nan]]))
    assert travel.sides.tolist() == [0]
