# SPDX-License-Identifier: Apache-2.0
"""Signals of drives to position, current and torque of their joints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal_drivers.calibrate.drive import drive_calibration
from comcal_drivers.calibrate.imu import imu_calibration
from comcal_drivers.devices.configuration import ImuConfig, JointConfig
from comcal_drivers.devices.description import Description, Device, load_device
from comcal_drivers.join.sample import Samples


def samples_of(*rows: Any) -> Samples:
    raw = np.array(rows, np.float64)
    n = len(raw)
    zeros = np.zeros(n, np.int64)
    return Samples(np.zeros(n), zeros, zeros, raw, zeros, np.zeros(n, np.uint8))


def drive(values: list[str], **signals: Any) -> Device:
    text = {
        "format": "comcal-device/1", "name": "test", "title": "test", "kind": "drive",
        "source": ["made for this test"], "parts": ["A"], "join": {"rule": "single"},
        "values": values, "calibrate": {"drive": signals},
    }  # fmt: skip
    return Device(Description.model_validate(text), Path("none.dbc"), {})


def config(device: Device, **given: Any) -> JointConfig:
    return JointConfig("l_knee", "can0", device, **given)


def test_counts_gear_sign_and_zero_make_the_position() -> None:
    device = drive(["p"], position={"signal": "p", "unit": "counts"})
    calibration = drive_calibration(
        config(device, counts_per_turn=2048.0, gear=100.0, sign=-1, zero=0.25), {}
    )
    values = calibration.apply(samples_of([0.0], [2048.0 * 100], [-51200.0])).values
    np.testing.assert_allclose(
        values[:, 0], [0.25, 0.25 - 2 * math.pi, 0.25 + math.pi / 2], rtol=1e-14
    )
    assert np.isnan(values[:, 1:]).all()


@pytest.mark.parametrize(
    ("unit", "one"), [("rad", 1.0), ("deg", math.pi / 180), ("turns", 2 * math.pi)]
)
def test_units_of_position_on_the_joint_side_see_no_gear(unit: str, one: float) -> None:
    device = drive(["p"], position={"signal": "p", "unit": unit, "side": "joint"})
    calibration = drive_calibration(config(device, gear=50.0), {})
    assert calibration.apply(samples_of([3.0])).values[0, 0] == pytest.approx(3.0 * one)


def test_current_per_mille_of_the_rated_current_keeps_its_sign() -> None:
    """CiA 402: 0x6078 is in per mille of 0x6075."""
    device = drive(["i"], current={"signal": "i", "unit": "A", "per_mille_of": "rated_current"})
    told = drive_calibration(config(device, sign=-1), {"rated_current": (4.0,)})
    given = drive_calibration(config(device, sign=-1, rated_current=8.0), {"rated_current": 4.0})
    assert told.apply(samples_of([-500.0])).values[0, 1] == pytest.approx(-2.0)
    assert given.apply(samples_of([-500.0])).values[0, 1] == pytest.approx(-4.0)
    with pytest.raises(ConfigError, match="rated_current") as caught:
        drive_calibration(config(device), {})
    assert "sources.can.joints.l_knee" in caught.value.next_step


def test_motor_torque_goes_through_the_gear_and_turns_with_the_joint() -> None:
    device = drive(["m"], torque={"signal": "m", "unit": "N m", "per_mille_of": "rated_torque"})
    calibration = drive_calibration(config(device, sign=-1, gear=30.0), {"rated_torque": (0.088,)})
    assert calibration.apply(samples_of([1000.0])).values[0, 2] == pytest.approx(-0.088 * 30)


def test_integers_are_spread_over_their_range_which_robot_yaml_may_replace() -> None:
    """MIT protocol: 0 is the lowest, all bits set the highest value."""
    linear = {"low": -12.5, "high": 12.5, "bits": 16}
    device = drive(
        ["p"], position={"signal": "p", "unit": "rad", "linear": linear, "side": "joint"}
    )
    raw = samples_of([0.0], [65535.0])
    shipped = drive_calibration(config(device), {}).apply(raw).values[:, 0]
    other = drive_calibration(config(device, ranges={"position": (-4.0, 4.0)}), {})
    np.testing.assert_allclose(shipped, [-12.5, 12.5], rtol=1e-15)
    np.testing.assert_allclose(other.apply(raw).values[:, 0], [-4.0, 4.0], rtol=1e-15)


def test_epos_position_and_current() -> None:
    """Two TPDOs of the real log: mA, quadcounts."""
    device = load_device("maxon_epos")
    calibration = drive_calibration(config(device, counts_per_turn=2048.0), {})
    values = calibration.apply(samples_of([-12.0, -56.0], [0.0, 300.0])).values
    np.testing.assert_allclose(values[:, 0], [-12 * 2 * math.pi / 2048, 0.0], rtol=1e-15)
    np.testing.assert_allclose(values[:, 1], [-0.056, 0.3], rtol=1e-15)


def test_imu_is_scaled_and_turned_into_its_link() -> None:
    text = {
        "format": "comcal-device/1", "name": "test", "title": "test", "kind": "imu",
        "source": ["made for this test"], "parts": ["A"], "join": {"rule": "single"},
        "values": ["x", "y", "z"], "calibrate": {"imu": {"scale": 0.01}},
    }  # fmt: skip
    device = Device(Description.model_validate(text), Path("none.dbc"), {})
    R = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    calibration = imu_calibration(ImuConfig("torso", "can0", device, R_link_device=R))
    values = calibration.apply(samples_of([-981.0, 10.0, 20.0])).values
    np.testing.assert_allclose(values, [[0.2, 0.1, 9.81]], rtol=1e-14)
