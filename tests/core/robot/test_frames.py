# SPDX-License-Identifier: Apache-2.0
"""Rotations are rotations, and their conventions are those of URDF."""

from __future__ import annotations

import doctest

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.robot import frames, kinematics, units
from comcal.robot.frames import apply, rotation_about, rotation_from_rpy, skew, transform_from

ANGLES = st.floats(-10.0, 10.0)
VECTORS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


def unit(v) -> np.ndarray:
    return np.array(v) / np.linalg.norm(v)


@settings(deadline=None, max_examples=50)
@given(VECTORS, ANGLES)
def test_rotation_is_proper_keeps_its_axis_and_is_undone_by_the_opposite_angle(v, angle):
    axis = unit(v)
    R = rotation_about(axis, angle)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-12)
    np.testing.assert_allclose(R @ rotation_about(axis, -angle), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation_about(-axis, -angle), R, atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(VECTORS, ANGLES, ANGLES)
def test_angles_about_one_axis_add(v, a, b):
    axis = unit(v)
    product = rotation_about(axis, a) @ rotation_about(axis, b)
    np.testing.assert_allclose(product, rotation_about(axis, a + b), atol=1e-11)


@pytest.mark.parametrize(("axis", "moved", "to"), [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_positive_quarter_turns_follow_the_right_hand(axis, moved, to):
    e = np.eye(3)
    np.testing.assert_allclose(rotation_about(e[axis], np.pi / 2) @ e[moved], e[to], atol=1e-15)


def test_rpy_is_roll_first_about_fixed_axes():
    roll, pitch, yaw = 0.3, -0.7, 1.9
    v = np.array([0.2, -0.5, 0.8])
    step = rotation_about([1, 0, 0], roll) @ v
    step = rotation_about([0, 1, 0], pitch) @ step
    step = rotation_about([0, 0, 1], yaw) @ step
    np.testing.assert_allclose(rotation_from_rpy([roll, pitch, yaw]) @ v, step, atol=1e-15)


def test_a_batch_of_rpy_gives_the_product_of_three_turns_for_each():
    rpy = np.random.default_rng(4).uniform(-3.0, 3.0, (2, 5, 3))
    roll, pitch, yaw = np.moveaxis(rpy, -1, 0)
    turns = rotation_about([0, 0, 1], yaw) @ rotation_about([0, 1, 0], pitch)
    np.testing.assert_allclose(
        rotation_from_rpy(rpy), turns @ rotation_about([1, 0, 0], roll), atol=1e-14
    )


def test_a_batch_of_angles_gives_the_rotation_of_each():
    angles = np.linspace(-2, 2, 12).reshape(3, 4)
    R = rotation_about([0.6, 0.0, 0.8], angles)
    assert R.shape == (3, 4, 3, 3)
    np.testing.assert_array_equal(R[2, 1], rotation_about([0.6, 0.0, 0.8], angles[2, 1]))


def test_skew_is_the_cross_product_also_in_batches():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose(apply(skew(a), b), np.cross(a, b), atol=1e-15)


def test_transforms_cancel_their_neighbours():
    R, p = rotation_from_rpy([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    T = transform_from(R, p)
    np.testing.assert_allclose((T @ [0.0, 0.0, 0.0, 1.0])[:3], p)
    np.testing.assert_allclose(T @ transform_from(R.T, -R.T @ p), np.eye(4), atol=1e-15)


@pytest.mark.parametrize("module", [frames, units])
def test_examples_in_docstrings_run(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def test_kinematics_has_no_broken_example():
    assert doctest.testmod(kinematics).failed == 0
