# SPDX-License-Identifier: Apache-2.0
"""Total CoM from twins: exact at random non-trivial values, on any mixture of tilts and slopes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.statics.two_pose import FootSide, height_gain, spread, total_com

length = st.floats(-0.5, 0.5)
angle = st.floats(-0.4, 0.4)


def line_of(x, y, z, pitch, roll):
    """alpha .. delta of a CoM at (x, y, z) on a floor of this slope."""
    beta, delta = -np.tan(pitch) / np.cos(roll), np.tan(roll)
    return [x - beta * z, beta, y - delta * z, delta]


@given(
    length, length, length, length, length,
    st.floats(0.02, 0.2), st.floats(-0.05, 0.05),
    st.lists(st.tuples(angle, angle, st.floats(-0.2, 0.2)), min_size=2, max_size=4),
)  # fmt: skip
def test_the_com_comes_back_from_any_tilts_and_slopes(r_u, l_u, r_w, l_w, y, U, A, poses):
    m_u, m_w = 13.4, 5.2
    rows, tilts = [], []
    for k, (tilt, pitch, roll) in enumerate(poses):
        tilt = 0.0 if k == 0 else tilt
        s, c = np.sin(tilt), np.cos(tilt)
        x = (m_u * r_u + m_w * (A + l_w * s + r_w * c)) / (m_u + m_w)
        z = (m_u * l_u + m_w * (U + l_w * c - r_w * s)) / (m_u + m_w)
        rows.append(line_of(x, y, z, pitch, roll))
        tilts.append(tilt)
    rows, tilts = np.array(rows), np.array(tilts)
    if np.ptp(tilts - np.arctan(rows[:, 1])) < 0.05:
        return
    foot = FootSide(*(np.array(v) for v in (m_u, r_u, l_u, A, U)))
    found = total_com(rows, np.array(m_u + m_w), tilts, foot)
    wanted = [
        (m_u * r_u + m_w * (A + r_w)) / (m_u + m_w),
        y,
        (m_u * l_u + m_w * (U + l_w)) / (m_u + m_w),
    ]
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_cad_of_the_feet_drops_out_when_only_the_floor_is_tilted():
    rows = np.array([line_of(0.02, 0.01, 0.4, 0.0, 0.0), line_of(0.02, 0.01, 0.4, 0.2, 0.0)])
    for wrong in (0.0, 0.3):
        foot = FootSide(*(np.array(v) for v in (10.0 + wrong, wrong, -wrong, 0.0, 0.1)))
        found = total_com(rows, np.array(18.6), np.zeros(2), foot)
        np.testing.assert_allclose(found, [0.02, 0.01, 0.4], atol=1e-12)


def test_an_error_of_the_feet_s_height_enters_z_with_their_share_of_the_mass():
    # method, section 1: dZ/dl_u = m_u/m_2 = 0.72 mm per mm for Table 1.
    rows = np.array([line_of(0.0, 0.0, 0.2, 0.0, 0.0), line_of(0.06, 0.0, 0.19, 0.0, 0.0)])
    z = [
        total_com(
            rows,
            np.array(18.6),
            np.array([0.0, 0.3]),
            FootSide(*(np.array(v) for v in (13.44, 0.0, l_u, 0.0, 0.1))),
        )[2]
        for l_u in (0.026, 0.027)
    ]
    assert z[1] - z[0] == pytest.approx(0.001 * 13.44 / 18.6, rel=1e-9)


@given(st.floats(0.06, 1.2), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_the_spread_is_the_angle_of_the_determinant(tilt, pitch_1, pitch_2):
    rows = np.array([line_of(0, 0, 0, pitch_1, 0), line_of(0, 0, 0, pitch_2, 0)])
    phi = np.arctan(rows[:, 1])
    wanted = abs((tilt - phi[1]) + phi[0])
    assert spread(rows, np.array([0.0, tilt])) == pytest.approx(wanted, abs=1e-12)


def test_the_height_gain_is_that_of_the_closed_form():
    rng = np.random.default_rng(2)
    tilt, noise = 0.5, 1e-5
    foot = FootSide(*(np.array(v) for v in (0.0, 0.0, 0.0, 0.0, 0.0)))
    clean = np.array([line_of(0.0, 0.0, 0.4, 0, 0), line_of(0.4 * np.sin(tilt), 0, 0, 0, 0)])
    z = []
    for _ in range(4000):
        rows = clean.copy()
        rows[:, 0] += noise * rng.standard_normal(2)
        z.append(total_com(rows, np.array(1.0), np.array([0.0, tilt]), foot)[2])
    assert np.std(z) / noise == pytest.approx(height_gain(tilt), rel=0.05)
