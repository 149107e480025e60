# SPDX-License-Identifier: Apache-2.0
"""Readings that settle, and readings that are late, are led along their slopes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.effects.registry import corrected
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import CHANNELS
from comcal.robot.model import Sense


@pytest.fixture(scope="module")
def rest(biped14) -> PoseTable:
    return biped14.measure(biped14.plan[:6])


def columns(robot, table: PoseTable, rate: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Slope columns as a recording writes them: of the sensors' own readings."""
    found = {}
    for sensor in table.wrench:
        sign = 1.0 if robot.sensors[sensor].sense is Sense.ON_ROBOT else -1.0
        for k, channel in enumerate(CHANNELS):
            found[f"slope.ft.{sensor}.{channel}"] = sign * rate[sensor][:, k]
    for name in ("q", "tau", "i"):
        for k, joint in enumerate(robot.tree.joint_names):
            found[f"slope.{name}.{joint}"] = rate[name][:, k]
    for k, axis in enumerate(("ax", "ay", "az")):
        found[f"slope.imu.{axis}"] = rate["imu"][:, k]
    return found


def reading_of(table: PoseTable) -> dict[str, np.ndarray]:
    return {
        **table.wrench,
        "q": table.q,
        "tau": table.torque,
        "i": table.current,
        "imu": table.imu,
    }


@pytest.mark.parametrize("sense", list(Sense))
def test_a_robot_that_comes_to_rest_ends_where_it_rests(biped14, rest, sense: Sense):
    """Every reading is at rest + A exp(-t / time): its slope is -A exp(-t / time) / time."""
    time, rng = 0.7, np.random.default_rng(1)
    sensors = {n: replace(s, sense=sense) for n, s in biped14.robot.sensors.items()}
    robot = replace(biped14.robot, sensors=sensors)
    still = replace(rest, current=rng.normal(size=rest.q.shape))
    away = {name: 0.1 * rng.normal(size=v.shape) for name, v in reading_of(still).items()}
    table = replace(
        still,
        wrench={s: w + away[s] for s, w in still.wrench.items()},
        q=still.q + away["q"],
        torque=still.torque + away["tau"],
        current=still.current + away["i"],
        imu=still.imu + away["imu"],
        motion=columns(robot, still, {name: -v / time for name, v in away.items()}),
    )
    change = Change("not_settled", "", {"time": time})
    found = reading_of(corrected(Assumed(robot), table, [change])[1])
    for name, value in reading_of(still).items():
        np.testing.assert_allclose(found[name], value, atol=1e-12)


@pytest.mark.parametrize("sense", list(Sense))
def test_a_late_sensor_is_brought_up_to_date_and_the_others_are_left_alone(
    biped14, rest, sense: Sense
):
    late, rng = 0.04, np.random.default_rng(2)
    sensors = {n: replace(s, sense=sense) for n, s in biped14.robot.sensors.items()}
    robot = replace(biped14.robot, sensors=sensors)
    rate = {name: rng.normal(size=v.shape) for name, v in reading_of(rest).items()}
    wrench = {**rest.wrench, "l_foot": rest.wrench["l_foot"] - late * rate["l_foot"]}
    table = replace(rest, wrench=wrench, motion=columns(robot, rest, rate))
    change = Change("timing_skew", "l_foot", {"time": late})
    found = reading_of(corrected(Assumed(robot), table, [change])[1])
    for name, value in reading_of(rest).items():
        np.testing.assert_allclose(found[name], value, atol=1e-12)


@pytest.mark.parametrize(("effect", "target"), [("not_settled", ""), ("timing_skew", "l_foot")])
def test_without_slopes_nothing_changes(biped14, rest, effect: str, target: str):
    change = Change(effect, target, {"time": 2.0})
    found = corrected(Assumed(biped14.robot), rest, [change])[1]
    for name, value in reading_of(rest).items():
        np.testing.assert_array_equal(reading_of(found)[name], value)


def test_a_slope_that_is_missing_in_a_pose_leaves_its_reading_alone(biped14, rest):
    slope = np.ones(len(rest))
    slope[2] = np.nan
    table = replace(rest, motion={"slope.ft.l_foot.fz": slope})
    change = Change("timing_skew", "l_foot", {"time": 1.0})
    moved = corrected(Assumed(biped14.robot), table, [change])[1].wrench["l_foot"]
    sign = 1.0 if biped14.robot.sensors["l_foot"].sense is Sense.ON_ROBOT else -1.0
    step = moved - rest.wrench["l_foot"]
    np.testing.assert_allclose(step[:, 2], sign * np.nan_to_num(slope), atol=1e-12)
    assert not np.delete(step, 2, axis=1).any()
