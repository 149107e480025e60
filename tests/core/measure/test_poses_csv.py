# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from comcal.errors import ConfigError, DataError, MissingColumnError, NotFiniteError
from comcal.measure.poses_csv import read_poses
from comcal.robot.model import Base, Noise, Plate, Robot, Sense, Sensor

Rows = list[dict[str, Any]]
Write = Callable[..., Path]
FAST = settings(
    deadline=None,
    max_examples=80,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


def test_numbers_are_read_exactly(biped: Robot, rows: Rows, write_table: Write) -> None:
    table = read_poses(write_table(rows), biped)
    assert table.pose == (1, 2, 3, 4)
    assert table.support == ("double", "double", "left", "right")
    for i, row in enumerate(rows):
        assert table.q[i].tolist() == [row[f"q.{j}"] for j in biped.tree.joint_names]
        for s in ("l", "r"):
            assert table.wrench[s][i].tolist() == [row[f"ft.{s}.{c}"] for c in CHANNELS]
    assert table.where(2) == "poses.csv:4 (pose 3)"


def test_every_optional_column_reaches_the_table(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    rows[0] |= {
        "configuration": "K1",
        "tilt": 0.1,
        "heading": 0.2,
        "stance": "s1",
        "condition": "cable off",
        "revisit": "a",
        "approach.l_hip": -1,
        "t": 12.5,
        "temperature.l": 31.5,
        "qd.l_hip": 0.001,
        "slope.ft.l.fz": 0.01,
        "sd.ft.l.fz": 0.3,
        "tau.l_hip": 3.0,
        "i.r_ankle": 0.5,
        "com.x": 0.01,
        "com.z": 0.6,
        "com.frame": "torso",
        "cop.y": 0.02,
        "imu.ax": 0.1,
        "imu.ay": 0.2,
        "imu.az": 9.8,
        "base.roll": 0.01,
        "base.pitch": 0.02,
        "n": 40,
    }
    for row in rows[1:]:
        row["com.frame"] = "torso"
    table = read_poses(write_table(rows), biped)
    assert table.configuration[0] == "K1"
    assert table.condition[0] == "cable off"
    assert table.revisit[0] == "a"
    assert table.stance[0] == "s1"
    assert (table.tilt[0], table.heading[0], table.t[0]) == (0.1, 0.2, 12.5)
    assert table.approach[0, 0] == -1
    assert np.isnan(table.approach[1:]).all()
    assert table.temperature["l"][0] == 31.5
    assert table.motion["qd.l_hip"][0] == 0.001
    assert table.motion["slope.ft.l.fz"][0] == 0.01
    assert table.torque[0, 0] == 3.0
    assert table.current[0, 3] == 0.5
    assert table.com_frame == "torso"
    np.testing.assert_array_equal(table.com[0], [0.01, np.nan, 0.6])
    np.testing.assert_array_equal(table.cop[0], [np.nan, 0.02])
    np.testing.assert_array_equal(table.imu[0], [0.1, 0.2, 9.8])
    np.testing.assert_array_equal(table.base_tilt[0], [0.01, 0.02])
    assert not any("unknown" in note for note in table.notes)


def test_selected_rows_keep_all_their_values(biped: Robot, rows: Rows, write_table: Write) -> None:
    for i, row in enumerate(rows):
        row |= {"t": float(i), "cop.x": i / 10, "qd.l_hip": i / 100, "temperature": 20.0 + i}
    table = read_poses(write_table(rows), biped).select([2, 0])
    assert table.pose == (3, 1)
    assert table.t.tolist() == [2.0, 0.0]
    assert table.cop[:, 0].tolist() == [0.2, 0.0]
    assert table.motion["qd.l_hip"].tolist() == [0.02, 0.0]
    assert table.temperature[""].tolist() == [22.0, 20.0]
    assert table.approach.shape == (2, 4)


def test_tare_is_subtracted_before_the_sense_is_resolved(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    ground = replace(biped, sensors={**biped.sensors, "l": Sensor("l", "l_ft", Sense.ON_GROUND)})
    tare = np.arange(1.0, 7.0)
    path = write_table(rows)
    table = read_poses(path, ground, {"l": (tare, np.full(6, 0.2))})
    plain = read_poses(path, biped)
    np.testing.assert_allclose(table.wrench["l"], -(plain.wrench["l"] - tare))
    np.testing.assert_array_equal(table.wrench["r"], plain.wrench["r"])
    np.testing.assert_allclose(table.tare_cov["l"], 0.04 * np.eye(6))
    np.testing.assert_array_equal(table.wrench_cov["l"], plain.wrench_cov["l"])
    assert any("no tare for r" in note for note in table.notes)


@pytest.mark.parametrize(
    "tares",
    [
        {"left": (np.zeros(6), np.zeros(6))},
        {"l": (np.zeros(3), np.zeros(6))},
        {"l": (np.full(6, np.nan), np.zeros(6))},
        {"l": (np.zeros(6), np.full(6, -1.0))},
    ],
)
def test_an_impossible_tare_is_refused(
    biped: Robot, rows: Rows, write_table: Write, tares: Mapping[str, Any]
) -> None:
    with pytest.raises(ConfigError, match="tare"):
        read_poses(write_table(rows), biped, tares)


def test_stated_noise_is_used_where_no_standard_error_is_given(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    robot = replace(
        biped,
        noise=Noise(0.3, 0.02, 0.001, revisit={"ft_force": 0.4, "encoder": 0.002}),
    )
    table = read_poses(write_table(rows), robot)
    np.testing.assert_allclose(
        np.diagonal(table.wrench_cov["l"], axis1=1, axis2=2),
        [[0.25, 0.25, 0.25, 0.0004, 0.0004, 0.0004]] * 4,
    )
    np.testing.assert_allclose(table.q_cov, 0.001**2 + 0.002**2)


def test_standard_errors_of_windows_are_pooled_over_poses(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    for row, se in zip(rows, (0.1, 0.3, 0.2, 5.0), strict=True):
        row |= {"se.ft.l.fz": se, "se.q.l_hip": 0.001}
    table = read_poses(write_table(rows), biped)
    pooled = (0.01 + 0.09 + 0.04) / 3
    np.testing.assert_allclose(table.wrench_cov["l"][:, 2, 2], [pooled, pooled, pooled, 25.0])
    np.testing.assert_allclose(table.wrench_cov["r"][:, 2, 2], 0.1**2)
    np.testing.assert_allclose(table.q_cov[:, 0], 1e-6)


def test_covariances_between_channels_are_kept_and_stay_possible(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    for row in rows:
        row |= {"se.ft.l.fx": 0.2, "se.ft.l.ty": 0.1, "cov.l.fx.ty": -0.01}
    table = read_poses(write_table(rows), biped)
    np.testing.assert_allclose(table.wrench_cov["l"][:, 0, 4], -0.01)
    np.testing.assert_allclose(table.wrench_cov["l"][:, 4, 0], -0.01)
    assert np.linalg.eigvalsh(table.wrench_cov["l"]).min() > 0
    for row in rows:
        row["cov.l.fx.ty"] = -0.03
    with pytest.raises(DataError, match="covariances"):
        read_poses(write_table(rows), biped)
    with pytest.raises(MissingColumnError, match=r"se\.ft\.l\.fx"):
        read_poses(
            write_table([{k: v for k, v in row.items() if k != "se.ft.l.fx"} for row in rows]),
            biped,
        )


def test_unknown_columns_are_ignored_with_one_note(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    for row in rows:
        row |= {"operator": "me", "tau.l_hipp": 3.0}
    notes = [n for n in read_poses(write_table(rows), biped).notes if "unknown" in n]
    assert notes == ["ignored unknown columns: operator, tau.l_hipp (did you mean tau.l_hip?)"]


def test_a_row_with_use_0_is_dropped_and_named_whatever_it_holds(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    for row in rows:
        row["use"] = 1
    rows[1] |= {"use": 0, "q.l_hip": "nan", "support": "?"}
    table = read_poses(write_table(rows), biped)
    assert table.pose == (1, 3, 4)
    assert "dropped by use = 0: pose 2 (line 3)" in table.notes
    for row in rows:
        row["use"] = 0
    with pytest.raises(DataError, match="no row is left"):
        read_poses(write_table(rows), biped)


@pytest.mark.parametrize("column", ["pose", "support", "q.r_hip"])
def test_a_required_column_is_missed_by_name(
    biped: Robot, rows: Rows, write_table: Write, column: str
) -> None:
    path = write_table([{k: v for k, v in row.items() if k != column} for row in rows])
    with pytest.raises(MissingColumnError, match=rf"poses\.csv: column {column} is absent"):
        read_poses(path, biped)


def test_a_mistyped_joint_is_recognised(biped: Robot, rows: Rows, write_table: Write) -> None:
    path = write_table(
        [{k.replace("q.r_hip", "q.r_hpi"): v for k, v in row.items()} for row in rows]
    )
    with pytest.raises(MissingColumnError, match=r"q\.r_hip.*did you mean it by q\.r_hpi"):
        read_poses(path, biped)


@pytest.mark.parametrize("column", ["q.l_hip", "ft.l.fz", "ft.r.tx"])
@pytest.mark.parametrize("text", ["", "nan", "NaN", "inf", "-inf", "1e999"])
def test_a_cell_without_a_finite_number_is_refused_with_its_place(
    biped: Robot, rows: Rows, write_table: Write, column: str, text: str
) -> None:
    rows[1][column] = text
    with pytest.raises(NotFiniteError, match=rf"poses\.csv:3.*{column}"):
        read_poses(write_table(rows), biped)


@pytest.mark.parametrize(
    ("column", "text", "words"),
    [
        ("q.l_hip", "0,5", "cells"),
        ("q.l_hip", "0.5deg", "not a number"),
        ("q.l_hip", "1_000", "not a number"),
        ("q.l_hip", "１", "not a number"),
        ("q.l_hip", "1e200", "nothing on a robot"),
        ("pose", "1", "stands in the table twice"),
        ("pose", "1.5", "not an integer"),
        ("pose", "", "not an integer"),
        ("support", "", "not one of"),
        ("support", "lefft", "did you mean left"),
        ("use", "2", "column use is 2"),
        ("approach.l_hip", "0.5", "approach.l_hip is 0.5"),
        ("se.ft.l.fz", "-0.1", "negative"),
        ("com.frame", "trso", "com.frame is trso"),
    ],
)
def test_a_faulty_cell_is_refused_with_its_place(
    biped: Robot, rows: Rows, write_table: Write, column: str, text: str, words: str
) -> None:
    rows[2][column] = text
    with pytest.raises(DataError, match=rf"poses\.csv:4.*{words}"):
        read_poses(write_table(rows), biped)


def test_some_channels_are_enough(biped: Robot, rows: Rows, write_table: Write) -> None:
    kept = [
        {k: v for k, v in row.items() if not k.startswith("ft.") or k.endswith(("fz", "ty"))}
        for row in rows
    ]
    table = read_poses(write_table(kept), biped)
    assert np.isnan(table.wrench["l"][:, [0, 1, 3, 5]]).all()
    assert np.isfinite(table.wrench["l"][:, [2, 4]]).all()
    assert np.isnan(table.wrench_cov["l"][:, 0]).all()
    assert np.isfinite(table.wrench_cov["l"][:, 2, 4]).all()


def test_a_standing_foot_without_columns_is_missed(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    kept = [{k.replace("ft.r.", "ft.rr."): v for k, v in row.items()} for row in rows]
    with pytest.raises(MissingColumnError, match=r"ft\.r\.\*.*did you mean ft\.rr"):
        read_poses(write_table(kept), biped)


def test_a_plate_replaces_the_sensors_of_its_feet(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    robot = replace(biped, plates={"floor": Plate("floor", "world", ("left", "right"))})
    kept = [
        {k.replace("ft.r.", "ft.floor."): v for k, v in row.items() if not k.startswith("ft.l.")}
        for row in rows
    ]
    table = read_poses(write_table(kept), robot)
    assert set(table.wrench) == {"floor"}


def test_a_lifted_foot_may_be_left_empty(biped: Robot, rows: Rows, write_table: Write) -> None:
    for c in CHANNELS:
        rows[2][f"ft.r.{c}"] = ""
    assert np.isnan(read_poses(write_table(rows), biped).wrench["r"][2]).all()


def test_a_table_without_any_measurement_is_refused(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    kept = [{k: v for k, v in row.items() if not k.startswith("ft.")} for row in rows]
    with pytest.raises(MissingColumnError, match="no column holds a measurement"):
        read_poses(write_table(kept), biped)
    for row in kept:
        row["com.x"] = 0.01
    assert read_poses(write_table(kept), biped).com[:, 0].tolist() == [0.01] * 4


def test_a_held_robot_needs_to_know_where_down_is(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    for row in rows:
        row["support"] = "none"
    with pytest.raises(NotFiniteError, match="where down is"):
        read_poses(write_table(rows), biped)
    for row in rows:
        row |= {"base.roll": 0.0, "base.pitch": 0.1}
    assert read_poses(write_table(rows), biped).support == ("none",) * 4


def test_a_fixed_arm_stands_on_nothing(biped: Robot, rows: Rows, write_table: Write) -> None:
    arm = replace(biped, base=Base.FIXED)
    with pytest.raises(DataError, match="not one of none"):
        read_poses(write_table(rows), arm)
    for row in rows:
        row["support"] = "none"
    assert len(read_poses(write_table(rows), arm)) == 4


def test_repeats_tell_the_scatter_between_visits(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    generator = np.random.default_rng(3)
    repeated: Rows = []
    for i in range(60):
        row = dict(rows[2]) | {"pose": i + 1, "revisit": "a"}
        for s in ("l", "r"):
            for c in CHANNELS[:3]:
                row[f"ft.{s}.{c}"] = float(row[f"ft.{s}.{c}"]) + generator.normal(0.0, 0.5)
        repeated.append(row)
    robot = replace(biped, noise=Noise(0.3, 0.02, revisit={"ft_force": 9.0}))
    table = read_poses(write_table(repeated), robot)
    assert table.wrench_cov["l"][0, 0, 0] == pytest.approx(0.25, rel=0.2)
    assert table.wrench_cov["l"][0, 3, 3] == pytest.approx(0.02**2)
    assert any("scatter between revisits" in note for note in table.notes)


def test_repeats_on_two_feet_do_not_count_since_the_load_may_be_shared_anyhow(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    repeated = [
        dict(rows[0]) | {"pose": i + 1, "revisit": "a", "ft.l.fz": 100.0 + 10 * (i % 2)}
        for i in range(20)
    ]
    table = read_poses(write_table(repeated), biped)
    assert table.wrench_cov["l"][0, 2, 2] == pytest.approx(0.01)


def test_a_line_without_end_is_mentioned(biped: Robot, rows: Rows, write_table: Write) -> None:
    path = write_table(rows)
    path.write_text(path.read_text().rstrip("\n"))
    assert any("cut off" in note for note in read_poses(path, biped).notes)


def test_a_line_that_a_killed_writer_left_is_not_a_pose(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    path = write_table(rows)
    text = path.read_text()
    path.write_text(text[:-3])
    assert read_poses(path, biped).pose == (1, 2, 3, 4)
    table = read_poses(path, biped, whole_lines=True)
    assert table.pose == (1, 2, 3)
    assert any("left out" in note for note in table.notes)


def test_superseded_poses_are_left_out_with_a_note(
    biped: Robot, rows: Rows, write_table: Write
) -> None:
    table = read_poses(write_table(rows), biped, superseded=(2, 9))
    assert table.pose == (1, 3, 4)
    assert "measured again under another number: pose 2 (line 3)" in table.notes
