# SPDX-License-Identifier: Apache-2.0
"""The statistics of a study call right intervals right and wrong ones wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from comcal.identify.coverage import (
    Trials,
    coverage_band,
    score_pooled,
    score_quantities,
    wilson_interval,
)
from comcal.identify.study_verdict import StudyLimits, summarise

LIMITS = StudyLimits((0.94, 0.96), 0.99, 1.03)


def trials(error: np.ndarray, sigma: float = 1.0, bound: float = 1.0, **changes: object) -> Trials:
    n, m = error.shape
    plain = {
        "kind": "robot, noise",
        "names": tuple(f"link.{j}" for j in range(m)),
        "units": ("m",) * m,
        "error": error,
        "sigma": np.full((n, m), sigma),
        "reported": np.ones((n, m), dtype=np.bool_),
        "bound": np.full(m, bound),
        "chi2": np.full(n, 10.0),
        "dof": np.full(n, 10.0),
        "ranks": np.full(n, 3),
    }
    return Trials(**{**plain, **changes})


def normal(n: int, m: int, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((n, m))


@settings(max_examples=30)
@given(n=st.integers(1, 4000), alpha=st.floats(1e-6, 0.2))
def test_band_holds_all_but_alpha_of_right_coverages_and_is_the_shortest(
    n: int, alpha: float
) -> None:
    low, high = (round(n * end) for end in coverage_band(n, alpha))
    assert binom.cdf(low - 1, n, 0.95) <= alpha / 2
    assert binom.sf(high, n, 0.95) <= alpha / 2 + 1e-12
    assert binom.cdf(low, n, 0.95) > alpha / 2
    assert high == 0 or binom.sf(high - 1, n, 0.95) > alpha / 2 - 1e-12


@given(share=st.floats(0.0, 1.0), n=st.floats(1.0, 1e6))
def test_ends_of_the_wilson_interval_are_one_quantile_away_from_the_share(
    share: float, n: float
) -> None:
    for end in wilson_interval(share, n):
        squared = 1.959964**2 * end * (1 - end) / n
        assert (share - end) ** 2 == pytest.approx(squared, rel=1e-5, abs=1e-12)


def test_right_intervals_of_efficient_estimates_pass() -> None:
    summary = summarise("s", (1,), [trials(normal(4000, 20))], LIMITS)
    assert summary.passed, summary.checks
    assert summary.pooled[-1].efficiency == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sigma": np.full((4000, 20), 0.9)}, "pooled"),
        ({"bound": np.full(20, 0.95)}, "Cramer-Rao"),
        ({"failed": ("robot: fell over",)}, "without a result"),
    ],
)
def test_each_limit_fails_alone(change: dict[str, object], words: str) -> None:
    summary = summarise("s", (1,), [trials(normal(4000, 20), **change)], LIMITS)
    failed = [check.what for check in summary.checks if not check.passed]
    assert not summary.passed
    assert any(words in what for what in failed)


def test_one_quantity_with_short_intervals_is_found_although_the_pool_is_right() -> None:
    sigma = np.ones((4000, 20))
    sigma[:, 7] = 0.85
    summary = summarise("s", (1,), [trials(normal(4000, 20), sigma=sigma)], LIMITS)
    assert [s.name for s in summary.quantities if not s.in_band] == ["link.7"]
    assert [c.passed for c in summary.checks] == [True, False, True, True]


def test_bias_is_counted_in_its_own_standard_errors() -> None:
    error = normal(400, 2)
    error -= error.mean(axis=0)
    error[:, 1] += 0.5 * error[:, 1].std()
    plain, shifted = score_quantities([trials(error)], 0.99)
    assert plain.bias == pytest.approx(0.0, abs=1e-9)
    assert shifted.bias == pytest.approx(0.5 * np.sqrt(400))


def test_repeating_a_quantity_adds_no_certainty_to_the_pool() -> None:
    single = score_pooled([trials(normal(500, 1))], "all")
    tenfold = score_pooled([trials(np.repeat(normal(500, 1), 10, axis=1))], "all")
    assert tenfold.interval == pytest.approx(single.interval, abs=1e-4)
    assert tenfold.efficiency_error == pytest.approx(single.efficiency_error)


def test_without_bounds_nothing_is_said_about_efficiency() -> None:
    summary = summarise("s", (1,), [trials(normal(400, 2), bound=np.nan)], LIMITS)
    assert len(summary.checks) == 3
    assert np.isnan(summary.pooled[-1].efficiency)
