# SPDX-License-Identifier: Apache-2.0
"""The convex solver's answers, judged by the conditions that define them."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from comcal.errors import MissingExtraError
from comcal.identify.least_norm import least_norm

pytest.importorskip("clarabel")


def has_a_point(N, b):
    found = linprog(np.zeros(N.shape[1]), A_ub=N, b_ub=b, bounds=(None, None))
    return found.status == 0


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 6), m=st.integers(1, 12))
def test_a_point_is_optimal_or_a_contradiction_is_one_and_no_larger_than_needed(seed, n, m):
    rng = np.random.default_rng(seed)
    N, b = rng.standard_normal((m, n)), rng.standard_normal(m)
    N /= np.linalg.norm(N, axis=1, keepdims=True)
    found = least_norm(N, b)
    if found.point is not None:
        slack = b - N @ found.point
        assert slack.min() > -1e-7
        assert found.multipliers.min() >= 0.0
        np.testing.assert_allclose(found.point, -N.T @ found.multipliers, atol=1e-7)
        assert np.abs(slack * found.multipliers).max() < 1e-7
        return
    rows = list(found.contradiction)
    assert not has_a_point(N[rows], b[rows])
    for row in rows:
        fewer = [i for i in rows if i != row]
        assert not fewer or has_a_point(N[fewer], b[fewer])


def test_rows_about_nothing_are_harmless_or_hopeless():
    N = np.array([[1.0, 0.0], [0.0, 0.0]])
    found = least_norm(N, np.array([-2.0, 0.5]))
    np.testing.assert_allclose(found.point, [-2.0, 0.0], atol=1e-8)
    np.testing.assert_allclose(found.multipliers, [2.0, 0.0], atol=1e-7)
    assert least_norm(N, np.array([-2.0, -0.5])).contradiction == (1,)
    assert least_norm(np.zeros((0, 3)), np.zeros(0)).point is not None


def test_without_the_solver_the_extra_to_install_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'comcal\[identify\]'") as caught:
        least_norm(np.eye(2), np.ones(2))
    assert caught.value.exit_code == 6
