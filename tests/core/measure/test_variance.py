# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from comcal.errors import DataError
from comcal.measure.variance import (
    OUTLIER_RATIO,
    assemble_covariance,
    channel_variance,
    pooled_variance,
    revisit_variance,
)

sigmas = arrays(np.float64, st.integers(1, 12), elements=st.floats(1e-6, 1e3))


def test_equally_noisy_poses_share_the_mean_square() -> None:
    variance, own = pooled_variance([0.1, 0.2, np.nan, 0.25])
    np.testing.assert_allclose(variance, (0.01 + 0.04 + 0.0625) / 3)
    assert not own.any()


def test_several_noisy_poses_do_not_hide_one_another() -> None:
    variance, own = pooled_variance([5.0, 1.0, 6.0, 1.1, 0.9, 7.0])
    assert own.tolist() == [True, False, True, False, False, True]
    np.testing.assert_allclose(variance[own], [25.0, 36.0, 49.0])


def test_a_quiet_pose_gets_no_extra_weight() -> None:
    variance, own = pooled_variance([0.001, 1.0, 1.0, 1.0])
    assert not own.any()
    np.testing.assert_allclose(variance, 3.000001 / 4)


def test_mostly_quantised_windows_still_share_one_variance() -> None:
    variance, own = pooled_variance([0.0, 0.0, 0.0, 0.0, 0.2])
    assert not own.any()
    np.testing.assert_allclose(variance, 0.04 / 5)


def test_no_standard_error_gives_no_variance() -> None:
    assert np.isnan(pooled_variance([np.nan, np.nan])[0]).all()


@settings(deadline=None, max_examples=60)
@given(sigmas)
def test_the_order_of_the_poses_does_not_matter(values: np.ndarray) -> None:
    order = np.random.default_rng(values.size).permutation(values.size)
    np.testing.assert_allclose(pooled_variance(values)[0][order], pooled_variance(values[order])[0])


@settings(deadline=None, max_examples=60)
@given(sigmas)
def test_own_variances_exceed_the_pool_by_more_than_the_ratio(values: np.ndarray) -> None:
    variance, own = pooled_variance(values)
    assert 2 * own.sum() <= values.size
    if own.any():
        assert variance[own].min() > OUTLIER_RATIO * variance[~own].max()


def test_weights_from_pooled_variances_are_better_than_from_single_windows() -> None:
    generator = np.random.default_rng(1)
    errors_pooled, errors_own = [], []
    for _ in range(400):
        samples = generator.normal(size=(20, 6))
        means, se = samples.mean(axis=1), samples.std(axis=1, ddof=1) / np.sqrt(6)
        for errors, variance in (
            (errors_pooled, pooled_variance(se)[0]),
            (errors_own, se**2),
        ):
            errors.append(float(np.average(means, weights=1 / variance)))
    assert np.var(errors_pooled) < 0.85 * np.var(errors_own)


def test_a_channel_that_never_moves_gets_the_stated_error() -> None:
    variance, own = channel_variance([0.0, 0.0, 1e-9], 0.1)
    np.testing.assert_allclose(variance, 0.01)
    assert not own.any()
    np.testing.assert_allclose(channel_variance([0.02, 0.02], 0.1)[0], 0.0004)
    np.testing.assert_allclose(channel_variance([np.nan], 0.1)[0], 0.01)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6))
def test_assembled_covariances_are_those_of_possible_variables(seed: int) -> None:
    generator = np.random.default_rng(seed)
    roots = generator.normal(size=(5, 6, 6)) * generator.uniform(0.1, 5.0, size=(5, 1, 1))
    window = roots @ roots.transpose(0, 2, 1)
    columns = [channel_variance(np.sqrt(window[:, k, k]), 0.1) for k in range(6)]
    variance = np.column_stack([v for v, _ in columns])
    cov = assemble_covariance(variance, window, np.column_stack([o for _, o in columns]), "here")
    assert np.linalg.eigvalsh(cov).min() > -1e-9 * cov.max()
    np.testing.assert_allclose(np.diagonal(cov, axis1=1, axis2=2), variance)


def test_equal_windows_keep_their_covariance() -> None:
    window = np.array([[[4.0, -1.5], [-1.5, 1.0]]] * 3)
    cov = assemble_covariance(
        np.array([[4.0, 1.0]] * 3), window, np.zeros((3, 2), dtype=np.bool_), "here"
    )
    np.testing.assert_allclose(cov, window)


def test_impossible_covariances_are_refused() -> None:
    window = np.array([[[4.0, 3.0], [3.0, 1.0]]])
    with pytest.raises(DataError, match="here: the covariances"):
        assemble_covariance(
            np.array([[4.0, 1.0]]), window, np.zeros((1, 2), dtype=np.bool_), "here"
        )


def test_scatter_between_visits_excludes_what_the_windows_explain() -> None:
    generator = np.random.default_rng(2)
    groups = [f"g{i // 5}" for i in range(500)]
    level = np.repeat(generator.normal(0, 30, 100), 5)
    values = (level + generator.normal(0, 0.4, 500) + generator.normal(0, 0.3, 500))[:, None]
    variance, freedom = revisit_variance(values, np.full((500, 1), 0.09), groups)
    assert freedom == 400
    assert variance == pytest.approx(0.16, rel=0.25)
    assert revisit_variance(values, np.full((500, 1), 9.0), groups)[0] == 0.0
    assert revisit_variance(values, values, [""] * 500) == (0.0, 0)
