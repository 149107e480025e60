# SPDX-License-Identifier: Apache-2.0
"""Readings that are wrong after the sensor: wiring, limits, stuck values, late ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.measure.source import Block
from comcal.robot.changes_text import parse_change
from comcal_sims.climate import Climate
from comcal_sims.faults.mistakes import Mistakes
from comcal_sims.faults.sensors import WrenchFaults
from comcal_sims.faults.support import FUNCTIONS, WORLDS, hidden_changes, worlds_for

N = 4


@pytest.fixture
def block(biped14: Any) -> Block:
    rng = np.random.default_rng(0)
    joints = len(biped14.robot.tree.joint_names)
    return Block(
        t=np.arange(N) / 100,
        q=rng.normal(size=(N, joints)),
        wrenches={s: 50 * rng.normal(size=(N, 6)) for s in biped14.robot.sensors},
        currents=rng.normal(size=(N, joints)),
        imu=rng.normal(size=(N, 3)),
    )


def spoilt(robot: Any, text: str, block: Block, pose: int = 1) -> Block:
    mistakes = Mistakes(robot, [parse_change(text)])
    mistakes.begin(pose)
    return mistakes.spoil(block)


def test_wiring_mistakes_do_what_their_name_says(biped14: Any, block: Block) -> None:
    robot, w = biped14.robot, block.wrenches["l_foot"]
    names = robot.tree.joint_names
    knee, hip = names.index("l_knee"), names.index("l_hip_pitch")

    def foot(text: str) -> Any:
        return spoilt(robot, text, block).wrenches["l_foot"]

    assert np.array_equal(foot("channel_swap@l_foot:channels=fx+fy"), w[:, [1, 0, 2, 3, 4, 5]])
    assert np.array_equal(foot("sign_flip@l_foot:channels=fx+ty"), w * [-1, 1, 1, 1, -1, 1])
    assert np.array_equal(
        foot("unit_error@l_foot:factor=1000,channels=tx+ty+tz")[:, 3:], 1e3 * w[:, 3:]
    )
    assert np.array_equal(foot("frame_handedness@l_foot:axis=y"), w * [1, -1, 1, 1, -1, 1])
    assert np.array_equal(foot("left_right_swap@l_foot:other=r_foot"), block.wrenches["r_foot"])
    assert np.array_equal(foot("sign_flip@imu:channels=ax"), w)
    imu = spoilt(robot, "sign_flip@imu:channels=ax", block).imu
    assert np.array_equal(imu, block.imu * [-1, 1, 1])
    swapped = spoilt(robot, "channel_swap@l_knee:channels=i,other=l_hip_pitch", block)
    assert np.array_equal(swapped.currents[:, knee], block.currents[:, hip])
    assert np.array_equal(swapped.q, block.q)


def test_limits_of_electronics(biped14: Any, block: Block) -> None:
    robot, w = biped14.robot, block.wrenches["l_foot"]
    clipped = spoilt(robot, "saturation@l_foot:level=20", block).wrenches["l_foot"]
    assert np.array_equal(clipped, np.clip(w, -20, 20))
    grid = spoilt(robot, "quantisation@l_foot:step=4,channels=fz", block).wrenches["l_foot"]
    assert np.array_equal(grid[:, 2] % 4, np.zeros(N))
    assert np.abs(grid - w).max() <= 2


def test_a_frozen_sensor_repeats_its_last_value(biped14: Any, block: Block) -> None:
    mistakes = Mistakes(biped14.robot, [parse_change("frozen_sensor@l_foot:channels=fz,poses=2")])
    before = mistakes.spoil(block)
    assert np.array_equal(before.wrenches["l_foot"], block.wrenches["l_foot"])
    mistakes.begin(2)
    stuck = mistakes.spoil(block).wrenches["l_foot"]
    assert np.array_equal(stuck[:, 2], np.full(N, block.wrenches["l_foot"][-1, 2]))
    assert np.array_equal(stuck[:, 0], block.wrenches["l_foot"][:, 0])


def test_a_late_sensor_reads_what_was() -> None:
    late = WrenchFaults([parse_change("timing_skew@s:time=0.1")], "s")
    t = np.arange(100) / 100
    ramp = np.outer(t, np.arange(6.0))
    first = late.reading(t[:50], ramp[:50], np.zeros(50))
    rest = late.reading(t[50:], ramp[50:], np.zeros(50))
    np.testing.assert_allclose(rest, ramp[40:90], atol=1e-12)
    np.testing.assert_allclose(first[:10], 0.0, atol=1e-12)


def test_sensors_warm_up_and_cool_again() -> None:
    t = np.linspace(0, 6000, 601)
    T = Climate(rise=10.0, time_constant=900.0, cooling_from=3000.0).temperature(t)
    assert T[300] == T.max() == pytest.approx(34.0, abs=0.5)
    assert np.all(np.diff(T[:300]) >= 0.0)
    assert T[-1] < 26.0


def test_functions_outside_the_catalogue_sit_where_they_belong(biped14: Any) -> None:
    robot = biped14.robot
    with pytest.raises(UsageError, match="sits at a joint, not at a sensor"):
        hidden_changes(["unknown@l_foot:function=hardening,amplitude=1"], robot, "builtin")
    with pytest.raises(UsageError, match="did you mean 'hardening'"):
        hidden_changes(["unknown@l_knee:function=hardning,amplitude=1"], robot, "builtin")
    assert set(FUNCTIONS) >= {"curvature", "creep", "sliding_mass", "uneven_floor"}


def test_every_world_makes_the_catalogue_of_static_effects() -> None:
    assert worlds_for("payload") == WORLDS
    assert worlds_for("not_settled") == ("pybullet", "mujoco")
    assert worlds_for("internal_torque_term") == ()
