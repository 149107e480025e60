# SPDX-License-Identifier: Apache-2.0
"""Sensors err as told: by the stated amount, from the seed, per pose, and not at all when exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.robot.model import Sense
from comcal_sims.adapter import EXACT, SensorAdapter, SensorErrors, sensor_errors_from
from comcal_sims.builtin_world import static_state

N = 2000


def _block(robot, pose, errors, seed=1, n=N):
    adapter = SensorAdapter(robot, errors, seed)
    adapter.begin(pose.pose)
    return adapter.block(np.arange(n) / 120, [static_state(robot, pose)] * n)


def test_exact_sensors_tell_the_truth(biped14):
    pose = biped14.plan[3]
    truth = static_state(biped14.robot, pose)
    block = _block(biped14.robot, pose, EXACT, n=2)
    assert np.array_equal(block.q[1], truth.q)
    for name, wrench in truth.wrenches.items():
        assert np.array_equal(block.wrenches[name][1], wrench)
    assert np.array_equal(block.imu[1], truth.imu)


def test_currents_are_torques_through_constant_gear_and_sign(biped14):
    robot, pose = biped14.robot, biped14.plan[3]
    truth = static_state(robot, pose)
    block = _block(robot, pose, EXACT, n=1)
    for i, joint in enumerate(robot.tree.joint_names):
        motor = robot.motors[joint]
        torque = motor.torque_constant * motor.gear * motor.sign * block.currents[0, i]
        assert torque == pytest.approx(truth.torques[i])
        assert np.isnan(block.torques[0, i])  # what the current tells is not told twice


def test_joints_without_motor_report_torque(table1):
    robot, pose = replace(table1.robot, motors={}), table1.plan[3]
    block = _block(robot, pose, EXACT, n=1)
    assert np.array_equal(block.torques[0], static_state(robot, pose).torques)
    assert np.all(np.isnan(block.currents))


def test_noise_has_the_stated_size_and_no_mean(table1):
    robot, pose = table1.robot, table1.plan[0]
    truth = static_state(robot, pose)
    block = _block(robot, pose, SensorErrors())
    for name, wrench in truth.wrenches.items():
        error = block.wrenches[name] - wrench
        sizes = np.repeat([0.5, 0.05], 3)
        assert error.std(axis=0) == pytest.approx(sizes, rel=0.1)
        assert np.all(np.abs(error.mean(axis=0)) < 5 * sizes / np.sqrt(N))


def test_the_encoder_error_stays_within_a_pose_and_changes_with_it(table1):
    robot, (one, other) = table1.robot, table1.plan[:2]
    errors = replace(EXACT, encoder=3.4907e-4)
    first, second = (_block(robot, pose, errors, n=5).q - pose.q for pose in (one, other))
    assert np.all(first == first[0])
    assert np.all(first[0] != second[0])
    assert 0.0 < np.abs(first).max() < 5 * 3.4907e-4


def test_the_bias_belongs_to_the_session(table1):
    robot, (one, other) = table1.robot, table1.plan[:2]
    errors = replace(EXACT, ft_force_bias=3.0, ft_moment_bias=0.2)
    biases = [
        _block(robot, pose, errors, seed, n=1).wrenches["l_foot"][0]
        - static_state(robot, pose).wrenches["l_foot"]
        for pose, seed in ((one, 1), (other, 1), (one, 2))
    ]
    assert biases[0] == pytest.approx(biases[1], abs=1e-12)
    assert np.all(np.abs(biases[0] - biases[2]) > 1e-6)
    assert 0.1 < np.abs(biases[0][:3]).max() < 15.0


def test_quantised_readings_lie_on_the_grid_nearest_to_the_truth(table1):
    robot, pose = table1.robot, table1.plan[0]
    errors = replace(EXACT, ft_force_step=0.25, encoder_step=1e-3)
    block = _block(robot, pose, errors, n=1)
    force = block.wrenches["r_foot"][0, :3]
    truth = static_state(robot, pose).wrenches["r_foot"]
    assert np.array_equal(force, np.round(force / 0.25) * 0.25)
    assert np.abs(force - truth[:3]).max() <= 0.125
    assert np.array_equal(block.wrenches["r_foot"][0, 3:], truth[3:])
    assert np.abs(block.q[0] - pose.q).max() <= 0.5e-3


def test_a_sensor_mounted_the_other_way_reads_the_opposite(table1):
    robot, pose = table1.robot, table1.plan[0]
    flipped = replace(robot.sensors["l_foot"], sense=Sense.ON_GROUND)
    other = replace(robot, sensors={**robot.sensors, "l_foot": flipped})
    upright, upside_down = (_block(r, pose, EXACT, n=1).wrenches for r in (robot, other))
    assert np.array_equal(upside_down["l_foot"], -upright["l_foot"])
    assert np.array_equal(upside_down["r_foot"], upright["r_foot"])


def test_options_change_single_sizes():
    assert sensor_errors_from({}, "") == SensorErrors()
    assert sensor_errors_from({"ft_force": 2}, "").ft_force == 2.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ft_forse": 1.0}, "sources.builtin: ft_forse .* did you mean ft_force"),
        ({"imu": -1.0}, "imu is -1.0"),
        ({"imu": float("nan")}, "imu is nan"),
        ({"imu": float("inf")}, "imu is inf"),
        ({"imu": "1 mm"}, "imu is '1 mm'"),
        ({"imu": True}, "imu is True"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        sensor_errors_from(options, "sources.builtin")
