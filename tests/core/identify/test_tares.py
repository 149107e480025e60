# SPDX-License-Identifier: Apache-2.0
"""The error of a tare is common to all poses: intervals cover it, and the misfit does not feel it.

The tares here are four to ten times worse than a pose mean, so that leaving them out would show.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_distribution

from comcal.identify.adjust import adjust
from comcal.identify.difference import route_difference
from comcal.identify.groups import groups_of
from comcal.identify.paper_route import paper_route
from comcal.identify.unknowns import unknowns_of
from comcal.statics.coefficients import balance_coefficients

DRAWS = 60


def tared(table, force, moment):
    """The table with correlated errors of its tares stated."""
    sigma = np.array([force] * 3 + [moment] * 3)
    correlation = np.eye(6)
    correlation[0, 4] = correlation[4, 0] = 0.6
    cov = correlation * np.outer(sigma, sigma)
    return replace(table, tare_cov={name: cov for name in table.wrench})


def fit(robot, table):
    return adjust(robot, unknowns_of(robot), groups_of(robot, table))


@pytest.mark.parametrize("name", ["table1", "biped14"])
def test_the_fit_scatters_as_its_covariance_says(name, odd, request):
    bench = request.getfixturevalue(name)
    plan = bench.plan if name == "table1" else bench.plan[::2]
    table, rng = tared(bench.measure(plan), 0.6, 0.06), np.random.default_rng(3)
    squares, chi2, rank = [], [], 0
    for _ in range(DRAWS):
        found = fit(bench.robot, odd.noisy(table, rng))
        off = found.singular * (
            found.seen.T @ ((found.theta - found.unknowns.cad) / found.unknowns.scale)
        )
        squares.append(off @ off)
        chi2.append(found.chi2)
        rank = found.rank
        dof = found.dof
    for values, freedom in ((squares, rank), (chi2, dof)):
        low, high = chi2_distribution.ppf([1e-4, 1 - 1e-4], DRAWS * freedom) / DRAWS
        assert low < np.mean(values) < high
    # On two feet alone their tares are the mass's error. On one foot and on both they show: what
    # both carry is what each carries and their tares.
    two_tares = 0.6 * np.sqrt(2.0) / bench.robot.gravity
    if name == "table1":
        assert np.sqrt(found.cov[0, 0]) == pytest.approx(two_tares, rel=0.05)
    else:
        assert np.sqrt(found.cov[0, 0]) < 0.1 * two_tares


def test_a_tare_of_one_sensor_in_several_supports_is_one_error(biped14):
    table = biped14.measure(biped14.plan[::2])
    step = np.array([0.3, -0.2, 0.5, 0.02, 0.03, -0.01])
    table = tared(table, 0.6, 0.06)
    found = fit(biped14.robot, table)
    shifted = {**table.wrench, "l_foot": table.wrench["l_foot"] + 0.01 * step}
    other = fit(biped14.robot, replace(table, wrench=shifted))
    wanted = np.zeros(found.unknowns.size)
    for group, sensitivity in zip(found.groups, found.sensitivity, strict=True):
        if "l_foot" in group.carrier.sensors:
            at = 6 * group.carrier.sensors.index("l_foot")
            wanted += sensitivity[:, :, at : at + 6].sum(axis=0) @ step
    seen = found.seen.T / found.unknowns.scale * found.singular[:, None]
    slope = seen @ (other.theta - found.theta) / 0.01
    np.testing.assert_allclose(slope, seen @ wanted, atol=0.02 * np.abs(slope).max())


def test_no_tare_and_an_exact_tare_are_the_same(table1):
    table = table1.noisy(table1.measure(), np.random.default_rng(1))
    none, exact = fit(table1.robot, table), fit(table1.robot, tared(table, 0.0, 0.0))
    np.testing.assert_array_equal(none.theta, exact.theta)
    tiny = fit(table1.robot, tared(table, 1e-7, 1e-8))
    np.testing.assert_allclose(tiny.theta, none.theta, atol=1e-9)
    np.testing.assert_allclose(tiny.cov, none.cov, rtol=1e-6, atol=1e-12)


def test_a_worse_tare_never_makes_the_estimate_better(table1):
    table = table1.noisy(table1.measure(), np.random.default_rng(2))
    covs = [fit(table1.robot, tared(table, f, 0.1 * f)).cov for f in (0.0, 0.1, 0.5, 2.0)]
    for better, worse in pairwise(covs):
        assert (np.diag(worse) > 0.99 * np.diag(better)).all()
    assert (np.diag(covs[-1]) > 1.1 * np.diag(covs[0])).any()


def test_coefficients_and_paper_route_scatter_as_they_say(table1, odd):
    rng = np.random.default_rng(4)
    tolerances = replace(table1.robot.tolerances, link_com=0.0, link_mass=0.0)
    robot = replace(table1.robot, tolerances=tolerances)
    table = tared(table1.measure([p for p in table1.plan if p.configuration]), 0.6, 0.06)
    found, coefficients = paper_route(robot, table), balance_coefficients(robot, table)
    best = found.choices[0]
    w, com, line, p = [], [], [], []
    for _ in range(50):
        drawn = odd.noisy(table, rng)
        paper = paper_route(robot, drawn)
        same = next(c for c in paper.choices if c.choice.solving == best.choice.solving)
        w.append(np.stack([same.w.imag, same.w.real], axis=1).ravel())
        com.append(paper.totals[0].carried_xyz)
        line.append(balance_coefficients(robot, drawn).values)
        p.append(route_difference(fit(robot, drawn), paper, drawn).p)
    # 50 draws: a standard deviation is uncertain by 10 %.
    assert np.abs(np.std(w, axis=0) / np.sqrt(np.diag(best.cov)) - 1).max() < 0.35
    first = np.sqrt(np.diag(found.totals[0].cov))
    assert np.abs(np.std(com, axis=0) / first - 1).max() < 0.35
    assert np.abs(np.std(line, axis=0) / coefficients.sigma - 1).max() < 0.4
    # Uniform between 0 and 1 when the sigma of the difference is right.
    assert 0.35 < np.mean(p) < 0.65
