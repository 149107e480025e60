# SPDX-License-Identifier: Apache-2.0
"""The leg solver of the 14-joint biped puts flat feet where they are wanted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.robot.frames import rotation_from_rpy
from comcal.robot.kinematics import place_links
from comcal_sims.robots.biped14 import (
    Biped14Parameters,
    SwingLeg,
    UpperBody,
    biped14_spec,
    double_pose,
    single_pose,
)

PARAMETERS = Biped14Parameters()
SPEC = biped14_spec(PARAMETERS)
TREE = SPEC.tree()


def _place(angles):
    return place_links(TREE, np.array([angles[name] for name in SPEC.joint_names]))


@given(
    x=st.floats(-0.08, 0.08),
    y=st.floats(-0.08, 0.08),
    z=st.floats(0.62, 0.77),
    roll=st.floats(-0.12, 0.12),
    ahead=st.floats(-0.2, 0.2),
)
@settings(max_examples=20)
def test_a_level_pelvis_stands_where_it_was_asked_to(x, y, z, roll, ahead):
    placements = _place(double_pose(PARAMETERS, x, y, z, roll=roll, ahead=ahead))
    R_floor_pelvis = rotation_from_rpy([roll, 0, 0])
    for side, sign in (("l", 1), ("r", -1)):
        R, p = (a[0] for a in placements.link(f"{side}_sole"))
        assert np.allclose(R_floor_pelvis @ R, np.eye(3), atol=1e-9)
        ground = R_floor_pelvis @ p + [x, y, z] - [0, 0, PARAMETERS.cut_height]
        expected = [sign * ahead / 2, sign * PARAMETERS.half_hip, 0.0]
        assert ground == pytest.approx(expected, abs=1e-9)


@given(y=st.floats(-0.05, 0.05), pitch=st.floats(-0.2, 0.4), ahead=st.floats(-0.2, 0.2))
@settings(max_examples=20)
def test_with_a_pitched_pelvis_both_feet_stay_flat_and_parallel(y, pitch, ahead):
    placements = _place(double_pose(PARAMETERS, y=y, z=0.70, pitch=pitch, ahead=ahead))
    (R_left, left), (R_right, right) = (placements.link(f"{side}_sole") for side in "lr")
    assert np.allclose(R_left, R_right, atol=1e-9)
    apart = R_left[0].T @ (left - right)[0]
    assert apart == pytest.approx([ahead, 2 * PARAMETERS.half_hip, 0.0], abs=1e-9)
    R_floor_pelvis = R_left[0].T
    assert -np.arcsin(R_floor_pelvis[2, 0]) == pytest.approx(pitch, abs=1e-9)


@given(
    stand=st.sampled_from("lr"),
    x=st.floats(-0.03, 0.06),
    y=st.floats(-0.02, 0.02),
    roll=st.floats(-0.1, 0.1),
    pitch=st.floats(-0.1, 0.25),
    waist=st.floats(-0.3, 0.3),
)
@settings(max_examples=20)
def test_on_one_foot_the_com_is_above_the_wanted_point(stand, x, y, roll, pitch, waist):
    angles = single_pose(
        PARAMETERS,
        stand,
        (x, y),
        z=0.72,
        roll=roll,
        pitch=pitch,
        upper=UpperBody(waist_roll=waist, l_shoulder=-1.0),
        swing=SwingLeg(hip_roll=0.2 if stand == "r" else -0.2),
    )
    placements = _place(angles)
    R, p = (a[0] for a in placements.link(f"{stand}_sole"))
    com = R.T @ (placements.total_com()[0] - p)
    assert com[:2] == pytest.approx([x, y], abs=1e-8)
    R_floor_pelvis = R.T
    assert np.arctan2(*R_floor_pelvis[2, 1:]) == pytest.approx(roll, abs=1e-9)
    assert -np.arcsin(R_floor_pelvis[2, 0]) == pytest.approx(pitch, abs=1e-9)
