# SPDX-License-Identifier: Apache-2.0
"""Times of samples: counted where the device counts, and the same however the stream is cut."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import ConfigError
from comcal_drivers.source.clock import SampleClock
from comcal_drivers.source.series import Series


def series(counter: np.ndarray, t: np.ndarray) -> Series:
    n = len(counter)
    return Series(np.arange(n), t, counter.astype(np.int64), np.zeros((n, 1)))


def cut(of: Series, at: list[int]) -> list[Series]:
    edges = [0, *sorted(at), len(of)]
    return [of[a:b] for a, b in itertools.pairwise(edges)]


def test_a_counter_that_goes_round_goes_on() -> None:
    counter = np.mod(np.arange(65_530, 65_560), 65_536)
    t = SampleClock("ft", 0.001, 65_536).times(series(counter, np.full(30, np.nan)))
    np.testing.assert_allclose(np.diff(t), 0.001, rtol=1e-9)
    assert t[0] == pytest.approx(65.530)


def test_lost_samples_leave_their_time() -> None:
    clock = SampleClock("ft", 0.01, 256)
    t = clock.times(series(np.array([3, 4, 9, 10]), np.full(4, np.nan)))
    np.testing.assert_allclose(t, [0.03, 0.04, 0.09, 0.10])
    assert clock.restarted == 0


def test_a_counter_that_begins_anew_goes_by_the_stamps() -> None:
    clock = SampleClock("ft", 0.01, 256)
    counter, stamps = np.array([100, 101, 0, 1]), np.array([0.0, 0.01, 2.01, 2.02])
    t = clock.times(series(counter, stamps))
    np.testing.assert_allclose(np.diff(t), [0.01, 2.0, 0.01])
    assert clock.restarted == 1


def test_time_never_goes_back_with_the_clock_of_the_stamps() -> None:
    clock = SampleClock("ft")
    stamps = np.array([10.0, 10.1, 5.0, 5.1, 5.2])
    t = clock.times(series(np.full(5, -1), stamps))
    assert (np.diff(t) > 0.0).all()
    np.testing.assert_allclose(np.diff(t)[[0, 2, 3]], 0.1)
    assert clock.turned_back == 1


def test_without_stamps_a_period_is_needed() -> None:
    nothing = series(np.full(3, -1), np.full(3, np.nan))
    np.testing.assert_allclose(SampleClock("ft", 0.5).times(nothing), [0.0, 0.5, 1.0])
    with pytest.raises(ConfigError, match="period"):
        SampleClock("ft").times(nothing)


@settings(deadline=None, max_examples=60)
@given(
    steps=st.lists(st.integers(1, 300), min_size=2, max_size=40),
    stamped=st.lists(st.floats(-0.5, 1.0), min_size=40, max_size=40),
    at=st.lists(st.integers(0, 40), max_size=5),
    counts=st.booleans(),
)
def test_times_do_not_depend_on_how_the_stream_is_cut(steps, stamped, at, counts) -> None:
    n = len(steps)
    of = series(np.mod(np.cumsum(steps), 1024), np.cumsum(stamped[:n]))
    modulus = 1024 if counts else None
    whole = SampleClock("ft", 0.01, modulus)
    pieces = SampleClock("ft", 0.01, modulus)
    expected = whole.times(of)
    found = np.concatenate([pieces.times(part) for part in cut(of, [min(k, n) for k in at])])
    np.testing.assert_array_equal(found, expected)
    assert (np.diff(expected) > 0.0).all()
    assert (whole.restarted, whole.turned_back) == (pieces.restarted, pieces.turned_back)


def test_pauses_of_a_clock_that_nothing_counts_are_noticed() -> None:
    t = np.array([10.0, 10.01, 10.02, 10.5, 10.51, 11.0, 11.01])
    of = series(np.full(7, -1), t)
    for at in ([], [3], [1, 2, 4, 5]):
        clock = SampleClock("ft", silence=0.1)
        for part in cut(of, at):
            clock.times(part)
        assert clock.paused == 2
    clock = SampleClock("ft", silence=0.1)
    clock.times(of[:3])
    clock.begin()
    clock.times(of[3:])
    assert clock.paused == 1


def test_stamps_of_an_adapter_that_counts_from_its_own_start_stay_as_they_are() -> None:
    """The origin is a date; times before it would be negative, which no file takes."""
    of = series(np.full(4, -1), 60.0 + np.array([0.0, 0.01, 0.02, 0.03]))
    for at in ([], [1, 2]):
        clock = SampleClock("ft", origin=1.7e9)
        t = np.concatenate([clock.times(part) for part in cut(of, at)])
        np.testing.assert_array_equal(t, of.t)
