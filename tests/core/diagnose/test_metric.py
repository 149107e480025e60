# SPDX-License-Identifier: Apache-2.0
"""Inner products against a healthy robot, held against the covariance written out in full."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comcal.diagnose.metric import Metric, metric, products, respread
from comcal.robot.tree import Array

ROWS, COLUMNS = 40, 24


def written_out(X: Array, r: Array, spread: Array) -> Metric:
    """Return the same from the covariance and its inverse."""
    cov = np.eye(len(r)) + (X * spread**2) @ X.T
    inverse = np.linalg.inv(cov)
    log_det = float(np.linalg.slogdet(cov)[1])
    return Metric(X.T @ inverse @ X, X.T @ inverse @ r, float(r @ inverse @ r), len(r), log_det)


def assert_same(found: Metric, expected: Metric) -> None:
    assert pytest.approx(expected.K, rel=1e-8, abs=1e-8) == found.K
    assert found.b == pytest.approx(expected.b, rel=1e-8, abs=1e-8)
    assert found.rr == pytest.approx(expected.rr, rel=1e-8)
    assert found.log_det == pytest.approx(expected.log_det, rel=1e-8, abs=1e-8)
    assert found.rows == expected.rows


def drawn(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    spread = rng.uniform(0.1, 2.0, COLUMNS) * (rng.random(COLUMNS) < 0.7)
    return rng.standard_normal((ROWS, COLUMNS)), 3.0 * rng.standard_normal(ROWS), spread


@given(st.integers(0, 2**32 - 1))
def test_healthy_spread_is_part_of_the_covariance(seed):
    X, r, spread = drawn(np.random.default_rng(seed))
    assert_same(metric(products(X, r), spread), written_out(X, r, spread))


@given(st.integers(0, 2**32 - 1), st.integers(0, COLUMNS))
def test_a_spread_changed_in_some_columns_is_as_good_as_found_anew(seed, changed):
    """Larger, smaller, taken away and new, in any number of columns."""
    rng = np.random.default_rng(seed)
    X, r, old = drawn(rng)
    new = old.copy()
    at = rng.choice(COLUMNS, changed, replace=False)
    new[at] = rng.uniform(0.0, 30.0, changed) * (rng.random(changed) < 0.8)
    before = metric(products(X, r), old)
    assert_same(respread(before, old, new), written_out(X, r, new))
