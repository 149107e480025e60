# SPDX-License-Identifier: Apache-2.0
"""Least squares of the serial chain: leave-one-out, what is determined, honest intervals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comcal.errors import NotFiniteError, RankError
from comcal.identify.sesc_fit import (
    NoiseKind,
    fit_sesc,
    left_out_errors,
    predict_com,
)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.booleans())
def test_left_out_error_equals_that_of_refitting_without_the_row(seed: int, full: bool) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(9, 5))
    if not full:
        rows[:, 4] = rows[:, 0] - 2.0 * rows[:, 3]
    com, sigma = rng.normal(size=9), rng.uniform(0.5, 2.0, 9)

    fit = fit_sesc(rows, com, sigma, NoiseKind.KNOWN)

    for i in range(9):
        others = np.arange(9) != i
        without = fit_sesc(rows[others], com[others], sigma[others], NoiseKind.KNOWN)
        assert fit.left_out[i] == pytest.approx(com[i] - rows[i] @ without.r, abs=1e-8)
    assert fit.rank == (5 if full else 4)
    assert fit.leverage.sum() == pytest.approx(fit.rank)


def test_batched_left_out_errors_equal_those_of_single_fits() -> None:
    rng = np.random.default_rng(5)
    rows, com = rng.normal(size=(4, 8, 3)), rng.normal(size=(4, 8))

    errors = left_out_errors(rows, com)

    for i in range(4):
        np.testing.assert_allclose(errors[i], fit_sesc(rows[i], com[i]).left_out, atol=1e-12)


def test_a_row_that_no_other_determines_cannot_be_left_out() -> None:
    rows = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

    fit = fit_sesc(rows, np.array([1.0, 2.0, 4.0, 7.0]))

    assert np.isinf(fit.left_out[3])
    assert np.isfinite(fit.left_out[:3]).all()


def test_only_functionals_in_the_row_space_are_predicted() -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(8, 3)) @ np.array([[1.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    truth = np.array([0.4, -0.1, 0.3, 0.2])
    fit = fit_sesc(rows, rows @ truth, np.full(8, 1e-3), NoiseKind.KNOWN)

    seen = predict_com(fit, np.array([[2.0, 2.0, 1.0, -1.0], [1.0, 0.0, 0.0, 0.0]]))

    assert fit.rank == 3
    assert fit.unknowns == 4
    assert list(seen.is_determined) == [True, False]
    assert seen.com[0] == pytest.approx(0.7)
    assert np.isnan(seen.com[1])
    assert np.isinf(seen.half_width[1])


@pytest.mark.parametrize(("dof", "factor"), [(1, 12.706), (2, 4.303), (12, 2.179)])
def test_few_degrees_of_freedom_widen_the_interval(dof: int, factor: float) -> None:
    rng = np.random.default_rng(dof)
    fit = fit_sesc(rng.normal(size=(3 + dof, 3)), rng.normal(size=3 + dof))

    assert fit.dof == dof
    assert fit.quantile() == pytest.approx(factor, abs=1e-3)


@pytest.mark.parametrize("dof", [1, 4])
def test_prediction_intervals_cover_new_measurements_as_often_as_they_say(dof: int) -> None:
    rng = np.random.default_rng(100 + dof)
    rows, truth = rng.normal(size=(4 + dof, 4)), rng.normal(size=4)
    new, n = rng.normal(size=(1, 4)), 3000
    inside = 0
    for _ in range(n):
        fit = fit_sesc(rows, rows @ truth + 0.01 * rng.normal(size=4 + dof))
        predicted = predict_com(fit, new, sigma=1.0)
        measured = new @ truth + 0.01 * rng.normal(size=1)
        inside += int(abs(predicted.com - measured)[0] <= predicted.half_width[0])

    assert inside / n == pytest.approx(0.95, abs=4 * np.sqrt(0.05 * 0.95 / n))


def test_lucky_residuals_do_not_shrink_a_known_error() -> None:
    rows = np.array([[1.0], [1.0], [1.0]])
    lucky = fit_sesc(rows, np.array([0.1, 0.1, 0.1]), np.full(3, 0.005))
    unlucky = fit_sesc(rows, np.array([0.1, 0.2, 0.0]), np.full(3, 0.005))

    assert lucky.scale == 1.0
    assert lucky.cov[0, 0] == pytest.approx(0.005**2 / 3)
    assert unlucky.scale == pytest.approx(0.1 / 0.005)


def test_weights_are_inverse_variances() -> None:
    rows, com = np.ones((2, 1)), np.array([0.0, 1.0])

    fit = fit_sesc(rows, com, np.array([1.0, 2.0]), NoiseKind.KNOWN)

    assert fit.r[0] == pytest.approx(0.2)
    assert fit.cov[0, 0] == pytest.approx(0.8)


def test_a_perfect_fit_is_refused() -> None:
    with pytest.raises(RankError, match="every fit is perfect"):
        fit_sesc(np.eye(3), np.ones(3))


def test_nothing_to_fit_is_refused() -> None:
    with pytest.raises(RankError, match="no CoM component"):
        fit_sesc(np.zeros((3, 2)), np.ones(3))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(bad: float) -> None:
    rows, com = np.random.default_rng(0).normal(size=(5, 2)), np.ones(5)
    com[3] = bad
    with pytest.raises(NotFiniteError, match="row 3"):
        fit_sesc(rows, com)
