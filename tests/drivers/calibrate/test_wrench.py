# SPDX-License-Identifier: Apache-2.0
"""Raw values to wrenches: matrix, bias, scales, units, handedness, limits, status."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from comcal.errors import ConfigError
from comcal.robot.frames import rotation_from_rpy
from comcal_drivers.calibrate.calibrated import status_notes
from comcal_drivers.calibrate.wrench import wrench_calibration
from comcal_drivers.devices.configuration import SensorConfig
from comcal_drivers.devices.description import load_device
from comcal_drivers.join.sample import LOST, SATURATED, STATUS, Counts, Samples


def samples_of(values: Any, status: Any = 0, flags: Any = 0) -> Samples:
    raw = np.atleast_2d(np.array(values, np.float64))
    n = len(raw)
    return Samples(
        np.arange(n) * 0.01,
        np.full(n, -1, np.int64),
        np.arange(n, dtype=np.int64),
        raw,
        np.broadcast_to(np.array(status, np.int64), (n,)).copy(),
        np.broadcast_to(np.array(flags, np.uint8), (n,)).copy(),
    )


def config_of(name: str, **given: Any) -> SensorConfig:
    return SensorConfig("l_foot", "can0", load_device(name), **given)


MATRIX = np.random.default_rng(4).normal(size=(6, 6)) * 1e5
ATI = {
    "matrix": tuple(MATRIX.ravel()), "counts_per_force": (1e6,), "counts_per_torque": (2e6,),
    "force_unit": (1.0,), "torque_unit": (1.0,),
}  # fmt: skip


def test_gages_times_matrix_over_counts_is_the_wrench() -> None:
    """Manual of the NETCANOEM: wrench = (M (gages - bias)) / counts per force or torque."""
    gages, bias = np.arange(6.0) * 100 + 7, np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])
    result = wrench_calibration(config_of("ati_netcanoem", bias=bias), ATI).apply(samples_of(gages))
    expected = MATRIX @ (gages - bias) / [1e6, 1e6, 1e6, 2e6, 2e6, 2e6]
    np.testing.assert_allclose(result.values[0], expected, rtol=1e-13)


def test_robot_yaml_wins_over_what_the_device_tells() -> None:
    config = config_of("ati_netcanoem", matrix=np.eye(6), counts_per_force=1.0)
    values = wrench_calibration(config, ATI).apply(samples_of([1.0, 2, 3, 4, 5, 6])).values
    np.testing.assert_allclose(values, [[1.0, 2, 3, 2e-6, 2.5e-6, 3e-6]], rtol=1e-15)


def test_pounds_become_newtons() -> None:
    told = {**ATI, "force_unit": (4.4482216152605,), "torque_unit": (0.1129848290276167,)}
    plain = wrench_calibration(config_of("ati_netcanoem"), ATI).gain
    pounds = wrench_calibration(config_of("ati_netcanoem"), told).gain
    np.testing.assert_allclose(pounds[:3], plain[:3] * 4.4482216152605, rtol=1e-15)
    np.testing.assert_allclose(pounds[3:], plain[3:] * 0.1129848290276167, rtol=1e-15)


def test_strain_counts_are_parts_of_the_full_scale() -> None:
    """CanBusAnalogSensor: (u16 - 0x8000) * full scale / 0x8000."""
    told = {"full_scale": (1500.0, 1500.0, 2000.0, 35.0, 35.0, 25.0)}
    half = samples_of([[16384.0, -16384, 8192, 16384, -8192, 32767]])
    result = wrench_calibration(config_of("iit_strain"), told).apply(half)
    np.testing.assert_allclose(
        result.values[0], [750, -750, 500, 17.5, -8.75, 25 * 32767 / 32768], rtol=1e-15
    )
    assert result.flags[0] == SATURATED


def test_jr3_moments_are_tenths_and_x_is_turned_round() -> None:
    """yarp-devices: fs * raw / 16384, moments * 0.1, x of force and moment negated."""
    told = {"full_scale": (100.0, 100.0, 200.0, 50.0, 50.0, 60.0)}
    raw = [8192.0, 4096, 2048, 8192, 4096, 2048]
    result = wrench_calibration(config_of("jr3_uc3m"), told).apply(samples_of(raw))
    np.testing.assert_allclose(result.values[0], [-50, 25, 25, -2.5, 1.25, 0.75], rtol=1e-15)


def test_three_axes_leave_moments_unknown() -> None:
    config = config_of("optoforce", scale=np.array([0.01, 0.01, 0.02]))
    values = wrench_calibration(config, {}).apply(samples_of([[100.0, 200, -300]])).values
    np.testing.assert_allclose(values[0], [1, 2, -6, np.nan, np.nan, np.nan], rtol=1e-15)


def test_rotation_turns_force_and_moment_and_signs_come_last() -> None:
    R = rotation_from_rpy(np.array([0.3, -0.2, 1.1]))
    signs = np.array([1.0, 1, -1, 1, -1, 1])
    config = config_of("sunrise_m8123", R_sensor_device=R, signs=signs)
    raw = np.array([1.0, 2, 3, 4, 5, 6])
    values = wrench_calibration(config, {}).apply(samples_of(raw)).values[0]
    np.testing.assert_allclose(values, signs * np.r_[R @ raw[:3], R @ raw[3:]], rtol=1e-13)


@pytest.mark.parametrize("level", [32767.0, -32768.0])
@pytest.mark.parametrize("channel", range(6))
def test_a_channel_at_its_limit_flags_the_sample_and_drops_nothing(
    level: float, channel: int
) -> None:
    raw = np.zeros((3, 6))
    raw[1, channel] = level
    result = wrench_calibration(config_of("ati_netcanoem"), ATI).apply(samples_of(raw))
    assert result.flags.tolist() == [0, SATURATED, 0]
    assert result.counts.saturated == 1
    assert np.isfinite(result.values).all()


def test_the_extra_byte_of_the_strain_flags_saturation() -> None:
    told = {"full_scale": (1.0,) * 6}
    status = [0, 1 | 1 << 2, 1, 1 << 8 | 2 << 14]
    result = wrench_calibration(config_of("iit_strain"), told).apply(
        samples_of(np.zeros((4, 6)), status)
    )
    assert result.flags.tolist() == [0, SATURATED, SATURATED, SATURATED]
    assert result.counts.status == {0: 2, 2: 1, 8: 1, 15: 1}


def test_ignored_bits_are_counted_and_others_still_flag() -> None:
    config = config_of("ati_netcanoem", ignore_status=(14,), ignore_where="robot.yaml:12")
    status = [0x4000, 0x4001, 0x8000 | 0x4000, 0]
    result = wrench_calibration(config, ATI).apply(samples_of(np.zeros((4, 6)), status, LOST))
    assert result.flags.tolist() == [LOST, LOST | STATUS, LOST | STATUS, LOST]
    assert result.counts.status == {0: 1, 14: 3, 15: 1}
    assert result.counts.ignored_status == {14: 3}
    notes = status_notes(
        config.device.description, Counts(samples=4) + result.counts, config.ignore_where
    )
    assert notes[1] == "bit 14 (CAN bus error) set on 3 of 4 samples, ignored by robot.yaml:12"
    assert notes[0] == "bit 0 (watchdog reset) set on 1 of 4 samples"


def test_overload_of_the_rft_is_saturation() -> None:
    result = wrench_calibration(config_of("robotous_rft"), {}).apply(
        samples_of([[50.0, 0, 0, 0, 0, 2000]], 0x20)
    )
    np.testing.assert_allclose(result.values[0], [1, 0, 0, 0, 0, 1], rtol=1e-15)
    assert result.flags[0] == SATURATED


def test_a_sample_has_the_same_bits_in_every_batch() -> None:
    raw = np.random.default_rng(1).integers(-30000, 30000, (1000, 6)).astype(float)
    calibration = wrench_calibration(config_of("ati_netcanoem"), ATI)
    whole = calibration.apply(samples_of(raw)).values
    for begin, end in ((0, 1), (1, 8), (8, 1000)):
        part = calibration.apply(samples_of(raw[begin:end])).values
        np.testing.assert_array_equal(part, whole[begin:end])


def test_what_nobody_says_is_asked_for_by_name() -> None:
    for missing in ("matrix", "counts_per_force"):
        told = {k: v for k, v in ATI.items() if k != missing}
        with pytest.raises(ConfigError, match=f"nobody says what the {missing}") as caught:
            wrench_calibration(config_of("ati_netcanoem"), told)
        assert f"give `{missing}` under sources.can.sensors.l_foot" in caught.value.next_step
    short = {**ATI, "matrix": tuple(range(30))}
    with pytest.raises(ConfigError, match=r"no usable matrix .*30 numbers, limit 36"):
        wrench_calibration(config_of("ati_netcanoem"), short)


def test_configured_arrays_are_not_written_to() -> None:
    matrix = np.eye(6)
    config = replace(config_of("ati_netcanoem"), matrix=matrix)
    wrench_calibration(config, ATI)
    np.testing.assert_array_equal(matrix, np.eye(6))
