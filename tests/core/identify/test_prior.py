# SPDX-License-Identifier: Apache-2.0
"""Data and CAD together: what comes from where is exact, and nothing of it passes for measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2 as chi2_distribution

from comcal.errors import UsageError
from comcal.identify.adjust import adjust
from comcal.identify.against_cad import cad_root
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.groups import groups_of
from comcal.identify.prior import MARKED_SHARE, with_prior
from comcal.identify.unknowns import unknowns_of
from comcal.robot.draw import draw_robot
from comcal.robot.model import Tolerances

SEEDS = st.integers(0, 10_000)
STRENGTHS = st.floats(1e-2, 1e2)
properties = settings(deadline=None, max_examples=40)


def data_information(fit):
    """What the measurements say, in the units of theta; singular where directions are unseen."""
    along = fit.seen * fit.singular / fit.unknowns.scale[:, None]
    return along @ along.T


@properties
@given(seed=SEEDS, strength=STRENGTHS, free_masses=st.booleans())
def test_it_is_the_gaussian_posterior(seed, strength, free_masses, random_fit):
    fit = random_fit(seed, free_masses=free_masses)
    found = with_prior(fit, strength)
    root = cad_root(fit.unknowns, strength)
    J, K = data_information(fit), np.linalg.inv(root @ root.T)
    scale = fit.unknowns.scale
    wanted = np.linalg.solve(J + K, J @ fit.theta + K @ fit.unknowns.cad)
    np.testing.assert_allclose(found.theta / scale, wanted / scale, atol=1e-8)
    cov = np.linalg.inv(J + K)
    np.testing.assert_allclose(found.cov, cov, rtol=1e-6, atol=1e-9 * np.abs(cov).max())
    # The share of an unknown is what the resolution matrix leaves open where masses are known.
    if not free_masses:
        np.testing.assert_allclose(found.share, 1 - np.diag(cov @ J), atol=1e-6)


@properties
@given(seed=SEEDS, strength=STRENGTHS, free_masses=st.booleans())
def test_shares_lie_between_none_and_all_and_grow_with_the_strength(
    seed, strength, free_masses, random_fit
):
    fit = random_fit(seed, free_masses=free_masses)
    weak, strong = with_prior(fit, strength), with_prior(fit, 2.0 * strength)
    L = np.random.default_rng(seed).standard_normal((20, fit.unknowns.size)) / fit.unknowns.scale
    for found in (weak, strong):
        shares = np.concatenate([found.share, found.share_of(L)])
        assert shares.min() >= 0.0
        assert shares.max() <= 1.0
    assert (strong.share_of(L) >= weak.share_of(L) - 1e-9).all()
    assert (strong.sigma <= weak.sigma * (1 + 1e-9)).all()


@properties
@given(seed=SEEDS, free_masses=st.booleans())
def test_a_vanishing_prior_leaves_the_fit_where_it_is_seen_and_is_all_there_is_where_not(
    seed, free_masses, random_fit
):
    fit = random_fit(seed, free_masses=free_masses)
    found, scale = with_prior(fit, 1e-5), fit.unknowns.scale
    seen = fit.seen.T / scale
    np.testing.assert_allclose(seen @ found.theta, seen @ fit.theta, atol=1e-6)
    assert found.share_of(seen).max() < 1e-4
    for strength in (1e-5, 1.0, 100.0):
        found = with_prior(fit, strength)
        # Numbers that differ only along unseen directions, prior and data taken as they are.
        hidden = (fit.unseen.T * scale) @ np.linalg.inv(found.prior_cov)
        np.testing.assert_allclose(found.share_of(hidden), 1.0, atol=1e-6)
        sigma = np.sqrt(np.einsum("ai,ij,aj->a", hidden, found.prior_cov, hidden))
        np.testing.assert_allclose(
            (hidden @ (found.theta - fit.unknowns.cad)) / sigma, 0, atol=1e-6
        )


def test_one_component_seen_alone_is_weighed_by_hand(chain, fit_of):
    robot = chain(boxes=[()], masses=[4.0])
    unknowns = unknowns_of(robot)  # mass, h of one link
    x, sigma = 1, 0.5e-3 * 4.0  # CoM x to 0.5 mm, CAD to 1 mm: information 4 to 1
    theta = unknowns.cad.copy()
    theta[x] += 5e-3 * 4.0
    found = with_prior(fit_of(unknowns, theta, np.eye(4)[:, [x]], unknowns.scale[[x]] / sigma), 1.0)
    (link,) = found.links
    assert link.com[0] == pytest.approx(0.02 + 5e-3 * 0.8)
    assert link.sigma[0] == pytest.approx(1e-3 * 0.2**0.5)
    np.testing.assert_allclose(link.share, [0.2, 1.0, 1.0])
    assert link.source == ("prior", "prior", "prior")
    np.testing.assert_allclose(link.com[1:], robot.tree.coms[0, 1:])
    assert found.chi2 == pytest.approx(25 / (1 + 0.25))
    # The data moved it by 4 mm, of which 1 - 0.2 of CAD's variance is to be expected.
    assert found.far == (("link0 x", pytest.approx(4 / 0.8**0.5)),)
    # At a third of the strength CAD has 1/37 of the information: no longer the prior's.
    weaker = with_prior(found.fit, 1 / 3)
    assert weaker.links[0].share[0] == pytest.approx(1 / 37)
    assert weaker.links[0].source == ("measured", "prior", "prior")
    assert MARKED_SHARE > 1 / 37


def test_what_a_sum_does_not_decide_is_the_priors(chain, fit_of):
    robot = chain(masses=[2.0, 2.0])
    unknowns = unknowns_of(robot)
    both = np.zeros((unknowns.size, 1))
    both[[unknowns.column(0), unknowns.column(1)]] = 1.0  # only the sum of both x, very well
    theta = unknowns.cad.copy()
    theta[[unknowns.column(0)]] += 0.01
    found = with_prior(fit_of(unknowns, theta, both, np.array([1e5])), 1.0)
    shares = [link.share[0] for link in found.links]
    assert shares == pytest.approx([0.5, 0.5], abs=1e-3)
    assert found.share_of(both.T) < 1e-3
    moved = [
        link.com[0] - old for link, old in zip(found.links, robot.tree.coms[:, 0], strict=True)
    ]
    assert moved == pytest.approx([0.0025, 0.0025], rel=1e-3)


def test_tolerances_are_about_coms_even_where_masses_are_free(chain, fit_of):
    robot = replace(chain(), tolerances=Tolerances(link_mass=0.05, link_com=0.002))
    unknowns = unknowns_of(robot, free_masses=True)
    nothing_much = np.zeros((unknowns.size, 1))
    nothing_much[0] = 1.0
    fit = fit_of(unknowns, unknowns.cad, nothing_much, np.array([1e-3]))
    for strength in (1.0, 4.0):
        for link in with_prior(fit, strength).links:
            assert link.mass_sigma == pytest.approx(0.05 * link.mass / strength, rel=1e-3)
            np.testing.assert_allclose(link.sigma, 0.002 / strength, rtol=1e-6)
    # A heavier link keeps its CoM: its first moment grows with it.
    theta = unknowns.cad.copy()
    theta[0] *= 1.04
    link = with_prior(fit_of(unknowns, theta, nothing_much, np.array([1e6])), 1.0).links[0]
    assert link.mass == pytest.approx(1.04 * 4.0, rel=1e-6)
    np.testing.assert_allclose(link.com, robot.tree.coms[0], rtol=1e-6)
    assert link.mass_source == "measured"


def test_an_exact_cad_stays_exact(chain, random_fit):
    robot = replace(chain(), tolerances=Tolerances(link_mass=0.0, link_com=0.0))
    found = with_prior(random_fit(1, 4, free_masses=False, robot=robot), 1.0)
    np.testing.assert_array_equal(found.theta, found.fit.unknowns.cad)
    np.testing.assert_array_equal(found.share, 1.0)


def test_trust_in_cad_is_no_trust_in_a_tare(biped14):
    unknowns = unknowns_of(biped14.robot, offsets=("l_foot",))
    at = slice(unknowns.first_offset, None)
    sigma = {s: np.diag(cad_root(unknowns, s)) for s in (0.1, 1.0, 10.0)}
    np.testing.assert_allclose(sigma[10.0][at], sigma[1.0][at])
    np.testing.assert_allclose(sigma[0.1][at], 10.0 * sigma[1.0][at])
    np.testing.assert_allclose(sigma[10.0][: at.start], 0.1 * sigma[1.0][: at.start])


@pytest.mark.parametrize("strength", [0.0, -1.0, np.nan, np.inf])
def test_a_strength_that_is_none_is_refused(strength, random_fit):
    with pytest.raises(UsageError, match="positive"):
        with_prior(random_fit(1, free_masses=False), strength)


def test_the_distance_of_data_and_prior_is_judged_fairly(chain, fit_of):
    unknowns, rng = unknowns_of(chain()), np.random.default_rng(5)
    directions, _ = np.linalg.qr(rng.standard_normal((unknowns.size, 4)))
    singular = np.array([900.0, 300.0, 60.0, 20.0])
    root, chi2, pulls = cad_root(unknowns), [], []
    for _ in range(300):
        truth = unknowns.cad + root @ rng.standard_normal(unknowns.size)
        noise = unknowns.scale * (directions @ (rng.standard_normal(4) / singular))
        found = with_prior(fit_of(unknowns, truth + noise, directions, singular), 1.0)
        chi2.append(found.chi2)
        pulls += [abs(pull) for _, pull in found.far]
    low, high = chi2_distribution.ppf([1e-3, 1 - 1e-3], 300 * 4) / 300
    assert low < np.mean(chi2) < high
    # Three sigmas of 2100 normal components: six are to be expected.
    assert len(pulls) < 20


def test_a_robot_far_from_its_urdf_contradicts_the_prior_and_a_weaker_one_does_not(chain, fit_of):
    unknowns = unknowns_of(chain())
    theta, column = unknowns.cad.copy(), unknowns.column(1)
    theta[column + 2] += 0.03 * 2.0  # 30 mm where CAD says 1 mm
    fit = fit_of(unknowns, theta, np.eye(unknowns.size), np.full(unknowns.size, 1e3))
    found = with_prior(fit, 1.0)
    assert found.contradict
    assert [name for name, _ in found.far] == ["link1 z"]
    assert found.agreeing_strength < 0.2
    weaker = with_prior(fit, found.agreeing_strength)
    assert weaker.chi2 == pytest.approx(weaker.dof, rel=1e-6)
    assert not weaker.contradict
    assert not with_prior(replace(fit, theta=unknowns.cad), 1.0).contradict


def test_errors_of_what_hangs_below_the_cuts_are_the_datas_not_the_priors(biped14):
    robot = replace(biped14.robot, tolerances=Tolerances(link_mass=0.1, link_com=0.05))
    unknowns = unknowns_of(robot)
    fit = adjust(robot, unknowns, groups_of(robot, biped14.measure(biped14.plan[::2])))
    seen = fit.seen.T / unknowns.scale
    from_cad = cad_inputs(fit).cov
    wanted = seen @ (fit.cov + from_cad) @ seen.T
    assert np.trace(seen @ from_cad @ seen.T) > 0.1 * np.trace(wanted)  # they matter here
    found = seen @ with_prior(fit, 1e-4).cov @ seen.T
    np.testing.assert_allclose(found, wanted, atol=1e-6 * wanted.max())


def test_robots_as_healthy_as_their_tolerances_are_covered(biped14):
    rng = np.random.default_rng(8)
    robot = replace(biped14.robot, tolerances=Tolerances(link_mass=0.0, link_com=0.004))
    squares = []
    for _ in range(8):
        true = draw_robot(robot, rng)
        table = biped14.noisy(biped14.measure(biped14.plan[::2], true_robot=true), rng)
        found = with_prior(adjust(robot, unknowns_of(robot), groups_of(robot, table)), 1.0)
        assert not found.contradict
        for link, real in zip(found.links, true.tree.links, strict=True):
            if link.share.max() < 1.0:
                squares.append(((link.com - real.com) / link.sigma) ** 2)
    # 240 components, correlated within a robot: a third of that many count.
    assert len(squares) == 80
    low, high = chi2_distribution.ppf([1e-3, 1 - 1e-3], 80) / 80
    assert low < np.mean(squares) < high
