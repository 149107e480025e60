# SPDX-License-Identifier: Apache-2.0
"""Not covered here: plates in the world, whose place only the user knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from comcal.errors import (
    ComcalError,
    DataError,
    NotBalancedError,
    NotStillError,
    SignError,
    UnitsError,
)
from comcal.measure.plausibility import check_plausible, implausibilities
from comcal.measure.poses_csv import read_poses
from comcal.measure.sole_hull import convex_hull, distance_outside
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot, Sense, Sensor

Rows = list[dict[str, Any]]
Write = Callable[..., Path]


@pytest.fixture
def table(biped: Robot, rows: Rows, write_table: Write) -> PoseTable:
    return read_poses(write_table(rows), biped)


def test_a_robot_at_rest_is_plausible(biped: Robot, table: PoseTable) -> None:
    assert list(implausibilities(table, biped)) == []


def test_degrees_are_detected_and_said(biped: Robot, table: PoseTable) -> None:
    with pytest.raises(UnitsError, match=r"poses\.csv:\d.*pi/180.*unit: deg") as error:
        check_plausible(replace(table, q=np.degrees(table.q)), biped)
    assert "degrees" in error.value.what
    assert "more joints" in error.value.what


def test_one_joint_in_degrees_is_named(biped: Robot, table: PoseTable) -> None:
    q = table.q.copy()
    q[:, 3] = np.degrees(q[:, 3])
    with pytest.raises(UnitsError, match=r"q\.r_ankle looks like degrees"):
        check_plausible(replace(table, q=q), biped)


def test_a_joint_far_beyond_its_limits_is_refused(biped: Robot, table: PoseTable) -> None:
    q = table.q.copy()
    q[2, 1] = 2.2
    with pytest.raises(DataError, match=r"poses\.csv:4 \(pose 3\): q\.l_ankle is far outside"):
        check_plausible(replace(table, q=q), biped)


def test_millimetres_and_multiples_of_g_are_detected(biped: Robot, table: PoseTable) -> None:
    com = table.com.copy()
    com[1, 0] = 26.3
    with pytest.raises(UnitsError, match=r"com\.x looks like millimetres"):
        check_plausible(replace(table, com=com), biped)
    imu = np.tile([0.01, 0.0, 1.0], (4, 1))
    with pytest.raises(UnitsError, match="multiples of g"):
        check_plausible(replace(table, imu=imu), biped)
    assert list(implausibilities(replace(table, imu=9.81 * imu), biped)) == []


def scaled(table: PoseTable, factors: dict[str, Any]) -> PoseTable:
    return replace(
        table, wrench={name: w * factors.get(name, 1.0) for name, w in table.wrench.items()}
    )


def test_kilogram_force_is_detected(biped: Robot, table: PoseTable) -> None:
    with pytest.raises(UnitsError, match="kgf"):
        check_plausible(scaled(table, {"l": 1 / 9.81, "r": 1 / 9.81}), biped)


@pytest.mark.parametrize(("unit", "factor"), [("N mm", 1e3), ("N cm", 1e2)])
def test_moments_in_another_unit_are_detected(
    biped: Robot, table: PoseTable, unit: str, factor: float
) -> None:
    moments = np.array([1, 1, 1, factor, factor, factor])
    with pytest.raises(UnitsError, match=f"moments look like {unit}"):
        check_plausible(scaled(table, {"l": moments, "r": moments}), biped)


def test_reversed_sensors_get_the_other_sense_proposed(biped: Robot, table: PoseTable) -> None:
    with pytest.raises(SignError, match=r"all sensors.*l: on_ground, r: on_ground"):
        check_plausible(scaled(table, {"l": -1.0, "r": -1.0}), biped)


def test_one_reversed_sensor_is_named(biped: Robot, table: PoseTable) -> None:
    with pytest.raises(SignError, match=r"sensor r \(not the others\).*to r: on_ground"):
        check_plausible(scaled(table, {"r": -1.0}), biped)


def test_a_wrong_sense_in_the_robot_file_is_proposed_back(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    robot = replace(biped, sensors={**biped.sensors, "l": Sensor("l", "l_ft", Sense.ON_GROUND)})
    with pytest.raises(SignError, match="l: on_robot"):
        check_plausible(read_poses(write_table(rows), robot), robot)


def exchanged(table: PoseTable) -> PoseTable:
    return replace(table, wrench={"l": table.wrench["r"], "r": table.wrench["l"]})


def test_exchanged_feet_show_in_poses_on_one_foot(biped: Robot, table: PoseTable) -> None:
    with pytest.raises(SignError, match=r"left and right are exchanged.*2 of 2"):
        check_plausible(exchanged(table), biped)


def test_one_wrong_support_is_told_from_exchanged_feet(biped: Robot, table: PoseTable) -> None:
    wrong = replace(table.select([0, 2, 2, 2]), support=("double", "left", "left", "right"))
    with pytest.raises(SignError, match="support says right"):
        check_plausible(wrong, biped)


def test_exchanged_feet_show_in_double_support(biped: Robot, table: PoseTable) -> None:
    links = list(biped.tree.links)
    links[0] = replace(links[0], com=np.array([0.01, 0.05, 0.2]))
    leaning = replace(biped, tree=replace(biped.tree, links=tuple(links)))
    double = table.select([0, 1])
    for name, share in (("l", 0.7), ("r", 0.3)):
        double.wrench[name][:, 2] = share * 41.0 * 9.81
    assert list(implausibilities(double, leaning)) == []
    with pytest.raises(SignError, match="left and right look exchanged"):
        check_plausible(exchanged(double), leaning)


def test_a_robot_that_something_else_holds_is_not_balanced(biped: Robot, table: PoseTable) -> None:
    wrench = {name: w.copy() for name, w in table.wrench.items()}
    wrench["l"][2, :3] *= 0.6
    with pytest.raises(NotBalancedError, match=r"pose 3.*do not carry.*\d N.*30 %"):
        check_plausible(replace(table, wrench=wrench), biped)


def test_a_force_far_from_the_sole_normal_is_not_balanced(biped: Robot, table: PoseTable) -> None:
    wrench = {name: w.copy() for name, w in table.wrench.items()}
    size = np.linalg.norm(wrench["l"][2, :3])
    wrench["l"][2, :3] = size * np.array([np.sin(0.7), 0.0, np.cos(0.7)])
    with pytest.raises(NotBalancedError, match=r"normal.*40 deg, limit 30 deg"):
        check_plausible(replace(table, wrench=wrench), biped)


def test_a_centre_of_pressure_outside_the_soles_is_not_balanced(
    biped: Robot, table: PoseTable
) -> None:
    wrench = {name: w.copy() for name, w in table.wrench.items()}
    wrench["l"][2, 4] -= 0.25 * wrench["l"][2, 2]
    with pytest.raises(NotBalancedError, match=r"pose 3.*mm outside the soles, limit 50 mm"):
        check_plausible(replace(table, wrench=wrench), biped)


@pytest.mark.parametrize(
    ("column", "fine", "moving"),
    [
        ("qd.l_hip", 0.04, -0.06),
        ("slope.q.l_hip", 0.04, 0.06),
        ("sd.q.l_hip", 0.01, 0.03),
        ("slope.ft.l.fz", 20.0, -25.0),
        ("slope.ft.l.tx", 20.0, None),
    ],
)
def test_columns_that_tell_of_motion_are_heard(
    biped: Robot, table: PoseTable, column: str, fine: float, moving: float | None
) -> None:
    quiet = replace(table, motion={column: np.array([0.0, fine, np.nan, 0.0])})
    assert list(implausibilities(quiet, biped)) == []
    if moving is not None:
        loud = replace(table, motion={column: np.array([0.0, fine, moving, 0.0])})
        with pytest.raises(NotStillError, match=rf"pose 3.*{column}"):
            check_plausible(loud, biped)


def test_planar_channels_are_enough_to_judge(biped: Robot, rows: Rows, write_table: Write) -> None:
    planar = [
        {k: v for k, v in row.items() if not k.startswith("ft.") or k[-2:] in ("fx", "fz", "ty")}
        for row in rows
    ]
    table = read_poses(write_table(planar), biped)
    assert list(implausibilities(table, biped)) == []
    with pytest.raises(SignError, match="all sensors"):
        check_plausible(scaled(table, {"l": -1.0, "r": -1.0}), biped)


def test_a_chain_without_urdf_is_judged_by_its_numbers_only(biped: Robot, table: PoseTable) -> None:
    chain = replace(biped, tree=replace(biped.tree, geometry_known=False))
    assert list(implausibilities(scaled(table, {"l": -1.0}), chain)) == []


@settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 3),
            st.sampled_from(["q.l_hip", "q.r_ankle", "support", "qd.l_hip", "com.x", "imu.ax"])
            | st.sampled_from([f"ft.{s}.{c}" for s in "lr" for c in ("fx", "fy", "fz", "tx")]),
            st.floats(-1e9, 1e9) | st.sampled_from(["", "left", "right", "double", 0.0, 1e-300]),
        ),
        max_size=6,
    )
)
def test_any_numbers_are_judged_without_a_hitch(
    biped: Robot, rows: Rows, write_table: Write, changes: list[tuple[int, str, Any]]
) -> None:
    for i, column, value in changes:
        rows[i] = dict(rows[i]) | {column: value}
    try:
        table = read_poses(write_table(rows), biped)
    except ComcalError:
        return
    for error in implausibilities(table, biped):
        assert error.where
        assert error.next_step


def test_the_hull_of_two_soles_spans_what_is_between_them() -> None:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 3], [1, 3], [0.5, 2], [0.5, 0]])
    assert convex_hull(corners).tolist() == [[0, 0], [1, 0], [1, 3], [0, 3]]
    assert distance_outside(np.array([0.5, 2.0]), corners) == 0.0
    assert distance_outside(np.array([4.0, 7.0]), corners) == pytest.approx(5.0)
    assert distance_outside(np.array([2.0, 0.0]), np.array([[0.0, 0.0], [1.0, 0.0]])) == 1.0
