# SPDX-License-Identifier: Apache-2.0
"""Means of windows and their standard errors. Not covered: memories longer than the window."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.measure.average import average

RATE = 125.0


def windows(count: int, n: int, phi: float, seed: int) -> np.ndarray:
    """Return AR(1) noise of unit innovations around zero, shape (count, n, 6)."""
    rng = np.random.default_rng(seed)
    x = np.zeros((count, n, 6))
    state = rng.standard_normal((count, 6)) / np.sqrt(1.0 - phi**2)
    for k in range(n):
        state = phi * state + rng.standard_normal((count, 6))
        x[:, k] = state
    return x


def coverage(count: int, n: int, phi: float) -> float:
    found = [average(np.arange(n) / RATE, x) for x in windows(count, n, phi, seed=n)]
    return float(np.mean([np.abs(a.mean) < 1.96 * a.standard_error for a in found]))


def test_squared_standard_error_of_25_white_samples_is_unbiased() -> None:
    t = np.arange(25) / RATE
    squares = [average(t, x).standard_error ** 2 for x in windows(4000, 25, 0.0, seed=1)]
    # Its own standard error: sqrt(2/24) of one, over 24000 channels, is 0.2 %.
    assert np.mean(squares) * 25 == pytest.approx(1.0, abs=0.02)


def test_white_noise_is_rarely_taken_for_correlated() -> None:
    t = np.arange(25) / RATE
    blocks = [average(t, x).block for x in windows(2000, 25, 0.0, seed=2)]
    assert np.mean(np.array(blocks) > 1) < 0.02


@pytest.mark.parametrize(
    ("n", "phi"), [(25, 0.0), (25, 0.5), (200, 0.0), (200, 0.5), (200, 0.9), (1000, 0.95)]
)
def test_interval_covers_the_mean_whatever_the_autocorrelation(n: int, phi: float) -> None:
    # 1.96 instead of Student's quantile costs 25 samples half a per cent or so.
    assert 0.91 < coverage(600, n, phi) < 0.975


def test_ignoring_the_autocorrelation_would_cover_much_less() -> None:
    x = windows(300, 200, 0.9, seed=4)
    naive = np.abs(x.mean(axis=1)) < 1.96 * x.std(axis=1, ddof=1) / np.sqrt(200)
    assert naive.mean() < 0.5


def test_effective_n_falls_with_the_memory_of_the_filter() -> None:
    t = np.arange(1000) / RATE
    white = np.median([average(t, x).effective_n for x in windows(20, 1000, 0.0, seed=5)])
    slow = np.median([average(t, x).effective_n for x in windows(20, 1000, 0.9, seed=5)])
    assert white > 900
    assert slow == pytest.approx(1000 * (1 - 0.9) / (1 + 0.9), rel=0.5)


@given(
    st.floats(-1e3, 1e3),
    st.floats(-10, 10),
    st.integers(2, 60),
    st.floats(0, 1e4),
)
def test_slope_of_a_straight_line_is_its_slope_at_any_hour(
    level: float, slope: float, n: int, start: float
) -> None:
    t = start + np.arange(n) / RATE
    found = average(t, (level + slope * (t - start))[:, None])
    assert found.slope[0] == pytest.approx(slope, abs=1e-6)
    assert found.mean[0] == pytest.approx(level + slope * (n - 1) / RATE / 2, abs=1e-9)


@given(st.floats(0.01, 100.0), st.floats(-100.0, 100.0))
def test_standard_error_scales_with_the_unit_and_ignores_the_offset(
    scale: float, offset: float
) -> None:
    t = np.arange(40) / RATE
    x = windows(1, 40, 0.3, seed=6)[0]
    one, other = average(t, x), average(t, scale * x + offset)
    np.testing.assert_allclose(other.standard_error, scale * one.standard_error, rtol=1e-6)
    assert other.block == one.block


def test_a_constant_channel_has_no_spread_and_disturbs_no_other() -> None:
    t = np.arange(25) / RATE
    x = windows(1, 25, 0.0, seed=7)[0]
    with_constant = average(t, np.column_stack([x, np.full(25, 3.0)]))
    assert with_constant.standard_error[-1] == 0.0
    np.testing.assert_allclose(with_constant.standard_error[:-1], average(t, x).standard_error)


def test_a_channel_with_a_gap_has_no_mean() -> None:
    x = np.ones((30, 2))
    x[3, 1] = np.nan
    found = average(np.arange(30) / RATE, x)
    assert found.mean[0] == 1.0
    assert np.isnan(found.mean[1])


def test_a_single_sample_tells_nothing_about_its_error() -> None:
    found = average([1.0], [[2.0]])
    assert found.mean.tolist() == [2.0]
    assert np.isnan(found.standard_error).all()
