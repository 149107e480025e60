# SPDX-License-Identifier: Apache-2.0
"""Rotations in the parametrisations of engines: each is checked by turning it back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.robot.frames import rotation_about, rotation_from_rpy, skew
from comcal_sims.rotations import (
    floor_rotation,
    quaternion_wxyz,
    quaternion_xyzw,
    rpy_from_rotation,
)

angles = st.floats(-np.pi, np.pi)
components = st.floats(-1.0, 1.0)


@given(st.tuples(angles, angles, angles))
def test_rpy_of_a_rotation_gives_the_rotation_back(rpy: tuple[float, float, float]) -> None:
    R = rotation_from_rpy(rpy)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(R)), R, atol=1e-9)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("roll", [0.0, 0.7])
def test_rpy_survives_gimbal_lock(pitch: float, roll: float) -> None:
    R = rotation_from_rpy((roll, pitch, -0.3))
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(R)), R, atol=1e-9)


@given(st.tuples(components, components, components), angles)
def test_quaternion_of_a_rotation_gives_the_rotation_back(
    axis: tuple[float, float, float], angle: float
) -> None:
    length = np.linalg.norm(axis)
    unit = np.array([0.0, 0.0, 1.0]) if length < 1e-3 else np.array(axis) / length
    R = rotation_about(unit, angle)
    w, *v = quaternion_wxyz(R)
    v = np.array(v)
    np.testing.assert_allclose(
        (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * skew(v), R, atol=1e-12
    )
    assert w >= 0.0


def test_scalar_is_last_in_xyzw() -> None:
    R = rotation_about([1.0, 0.0, 0.0], 0.2)
    np.testing.assert_allclose(quaternion_xyzw(R), [np.sin(0.1), 0.0, 0.0, np.cos(0.1)])


def test_positive_floor_pitch_is_toes_down_and_positive_roll_lifts_the_left() -> None:
    toes, left, _ = np.eye(3)
    assert (floor_rotation(0.0, 0.1) @ toes)[2] < 0.0
    assert (floor_rotation(0.1, 0.0) @ left)[2] > 0.0
