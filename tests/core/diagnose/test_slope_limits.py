# SPDX-License-Identifier: Apache-2.0
"""Noise exceeds the limits of slopes as seldom as stated, whatever the size of the table."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.diagnose.gates.slope_limits import (
    FALSE_ALARMS,
    MAD,
    largest_limit,
    mean_square_limit,
    shared_noise,
)

NUMBERS = 2_000_000
"""Slopes drawn for each size of a table."""


@pytest.mark.parametrize(("poses", "channels"), [(8, 2), (8, 6), (9, 3), (21, 5), (21, 12)])
def test_a_table_of_noise_is_suspected_as_seldom_as_stated(poses: int, channels: int) -> None:
    tables = NUMBERS // (poses * channels)
    slopes = np.random.default_rng(poses).standard_normal((tables, poses, channels))
    squares = (slopes**2).mean(axis=1)
    noise = np.array([shared_noise(spreads) for spreads in squares])
    moved = squares.max(axis=1) > noise * mean_square_limit(poses, poses, channels)
    sizes = np.abs(slopes)
    typical = np.median(sizes, axis=1) / MAD
    noise = np.array([shared_noise(spreads) for spreads in typical])
    limit = largest_limit(poses * channels, poses, channels)
    plainly = sizes.max(axis=(1, 2)) > noise * limit
    most = FALSE_ALARMS * tables + 3.0 * np.sqrt(FALSE_ALARMS * tables)
    assert 0.2 * FALSE_ALARMS * tables < moved.sum() < most
    assert plainly.sum() < most


def test_limits_are_wide_where_little_is_known_and_narrow_where_much_is() -> None:
    for limit in (mean_square_limit, largest_limit):
        assert limit(8, 8, 3) > limit(21, 21, 12) > limit(100, 100, 24) > 1.0
    assert largest_limit(252, 21, 12) < 10.0


def test_one_channel_says_nothing_about_its_own_noise() -> None:
    assert mean_square_limit(21, 21, 1) == np.inf
    assert shared_noise(np.array([3.0])) == 3.0
