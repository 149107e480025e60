# SPDX-License-Identifier: Apache-2.0
"""The nearest physically possible robot: by hand, by another solver, and on a whole biped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import chi2 as chi2_distribution

from comcal.identify.adjust import adjust
from comcal.identify.against_cad import cad_root
from comcal.identify.bounds import Bound, physical_bounds
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.consistent import SMALLEST, WEAK, consistent_fit
from comcal.identify.groups import groups_of
from comcal.identify.solution import total_com_at
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import NONE
from comcal.robot.model import BelowCut, Foot, Sensor
from comcal.robot.tree import Box

pytest.importorskip("clarabel")


def box(centre, size):
    T = np.eye(4)
    T[:3, 3] = centre
    return Box(T, np.array(size, np.float64))


CENTRE = (0.02, -0.01, 0.1)
"""CoM of the first link."""
SMALL = box(CENTRE, (0.02, 0.02, 0.02))


def at(size, column, value):
    row = np.zeros(size)
    row[column] = value
    return row


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(-0.03, 0.03), min_size=3, max_size=3), st.floats(1e2, 1e4))
def test_one_link_seen_equally_well_all_round_is_clipped_to_its_box(chain, fit_of, off, singular):
    robot = chain(boxes=[(SMALL,)], masses=[4.0])
    unknowns = unknowns_of(robot)
    theta = unknowns.cad.copy()
    theta[1:] += 4.0 * np.array(off)
    found = consistent_fit(fit_of(unknowns, theta, np.eye(4), np.full(4, singular)))
    clipped = np.clip(off, -0.01, 0.01)
    (link,) = found.links
    np.testing.assert_allclose(link.com, CENTRE + clipped, atol=1e-8)
    np.testing.assert_allclose(link.before, np.add(CENTRE, off), atol=1e-8)
    excess = (off - clipped) / 0.1 * singular  # scale of h: 0.1 m of the body's mass
    assert found.chi2_increase == pytest.approx(excess @ excess, rel=1e-5, abs=1e-5)
    clear = np.abs(excess) > 1e-3
    for i in range(3):
        if clear[i]:
            assert link.source[i] == "bound"
        elif abs(off[i]) < 0.00999:
            assert link.source[i] == "measured"
    if clear.any() and (clear == (np.abs(excess) > 0)).all():
        assert found.dof == clear.sum()
        wanted = chi2_distribution.sf(excess @ excess, clear.sum())
        assert found.p == pytest.approx(wanted, rel=1e-3, abs=1e-12)
        hardest = np.argmax(np.abs(excess))
        side = "upper" if off[hardest] > 0 else "lower"
        words = found.active[0].bound.words
        assert f"link0 CoM {'xyz'[hardest]} at its {side} bound" in words or (
            np.sort(np.abs(excess))[-2] > 0.99 * np.abs(excess).max()
        )


@pytest.mark.parametrize("seed", range(8))
def test_another_solver_finds_the_same(seed, chain, random_fit):
    robot = chain(boxes=[(SMALL,), (box((0.02, -0.01, 0.12), (0.01, 0.03, 0.02)),)])
    fit = random_fit(seed, 5, free_masses=True, robot=robot)
    unknowns = fit.unknowns
    fit = replace(fit, theta=unknowns.cad + 10.0 * (fit.theta - unknowns.cad))
    found = consistent_fit(fit)
    assert found.active
    # The same problem, put together anew: data along what is seen, CAD along the rest.
    scale, bounds = unknowns.scale, physical_bounds(unknowns).bounds
    root = cad_root(unknowns, smallest=SMALLEST)
    K = np.linalg.inv(root @ root.T)
    along = fit.seen * fit.singular / scale[:, None]
    J = along @ along.T
    # CAD's part that the data leave open: what is free along the unseen directions only.
    hidden = scale[:, None] * fit.unseen
    left = K @ hidden @ np.linalg.inv(hidden.T @ K @ hidden) @ hidden.T @ K
    H = np.outer(scale, scale) * (J + WEAK**2 * left)
    fitted = (fit.theta - unknowns.cad) / scale
    g = np.outer(scale, scale) * J @ fitted
    rows = np.array([b.row for b in bounds]) * scale
    limit = np.array([b.limit - b.row @ unknowns.cad for b in bounds])
    # SLSQP wants its problem well conditioned: v = L^T u, with H = L L^T.
    L = np.linalg.cholesky(H)
    centre, rows_v = np.linalg.solve(L, g), np.linalg.solve(L, rows.T).T
    size = np.linalg.norm(rows_v, axis=1)
    other = minimize(
        lambda v: 0.5 * np.sum((v - centre) ** 2),
        np.linalg.solve(H, g) @ L,
        jac=lambda v: v - centre,
        constraints={
            "type": "ineq",
            "fun": lambda v: (limit - rows_v @ v) / size,
            "jac": lambda v: -rows_v / size[:, None],
        },
        method="SLSQP",
        options={"maxiter": 1000, "ftol": 1e-11},
    )
    assert other.success
    ours = (found.theta - unknowns.cad) / scale
    assert (limit - rows @ ours).min() > -1e-9
    np.testing.assert_allclose(ours, np.linalg.solve(L.T, other.x), atol=1e-6)
    away = fit.seen.T @ (ours - fitted) * fit.singular
    assert found.chi2_increase == pytest.approx(away @ away, rel=1e-6)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000), free_masses=st.booleans())
def test_without_a_bound_in_the_way_the_fit_stays(seed, free_masses, random_fit):
    fit = random_fit(seed, free_masses=free_masses)
    fit = replace(fit, theta=fit.unknowns.cad + 1e-3 * (fit.theta - fit.unknowns.cad))
    found = consistent_fit(fit)
    seen = fit.seen.T / fit.unknowns.scale
    np.testing.assert_allclose(seen @ found.theta, seen @ fit.theta, atol=1e-8)
    assert not found.active
    assert found.chi2_increase < 1e-12
    assert found.p == 1.0
    assert not found.contradicted


def test_what_nobody_measured_gives_way_first(chain, fit_of):
    robot = chain(boxes=[(SMALL,), ()])
    unknowns = unknowns_of(robot)
    first, second = unknowns.column(0), unknowns.column(1)
    # Only the sum of both x is seen: 0.24 kg m more than CAD.
    both = at(unknowns.size, [first, second], 1.0) * unknowns.scale
    theta = unknowns.cad + at(unknowns.size, [first, second], 0.12)
    found = consistent_fit(fit_of(unknowns, theta, both[:, None], np.array([1e3])))
    assert found.links[0].com[0] == pytest.approx(0.03, abs=1e-6)  # the face of its box
    assert found.links[0].source[0] == "bound"
    assert found.links[1].source[0] == "prior"
    # The second link takes what the first one cannot.
    assert found.theta[second] - unknowns.cad[second] == pytest.approx(0.24 - 0.04, rel=1e-3)
    assert found.chi2_increase < 1e-2


def test_a_bound_on_what_nobody_measured_costs_nothing(chain, fit_of):
    # CAD has this CoM 1 mm in front of its box, and no pose says a word about it.
    robot = chain(boxes=[(box((0.009, -0.01, 0.1), (0.02, 0.02, 0.02)),), ()])
    unknowns = unknowns_of(robot)
    found = consistent_fit(
        fit_of(unknowns, unknowns.cad, at(unknowns.size, 0, 1.0)[:, None], np.array([1e3]))
    )
    assert [a.bound.component for a in found.active] == ["link0 x"]
    assert found.links[0].com[0] == pytest.approx(0.019)
    assert (found.dof, found.p) == (0, 1.0)
    assert found.chi2_increase < 1e-12


def test_a_moment_without_its_mass_is_no_measured_com(chain, fit_of):
    unknowns = unknowns_of(chain(), free_masses=True)
    z, mass = unknowns.column(0) + 2, unknowns.mass_column(0)
    seen = np.eye(unknowns.size)[:, [z, mass]]
    for columns, source in ((seen[:, :1], "prior"), (seen, "measured")):
        fit = fit_of(unknowns, unknowns.cad, columns, np.full(columns.shape[1], 1e3))
        assert consistent_fit(fit).links[0].source == ("prior", "prior", source)


def test_a_negative_mass_comes_to_its_bound(chain, fit_of):
    unknowns = unknowns_of(chain(), free_masses=True)
    theta = unknowns.cad.copy()
    theta[1] = -0.4
    size = unknowns.size
    found = consistent_fit(fit_of(unknowns, theta, np.eye(size), np.full(size, 5.0)))
    assert [a.bound.words for a in found.active] == ["link1 mass at its lower bound 0.02 kg"]
    assert found.links[1].mass == pytest.approx(0.02)
    assert found.links[1].mass_source == "bound"
    assert found.chi2_increase == pytest.approx((0.42 / 2.0 * 5.0) ** 2, rel=1e-6)
    assert not found.contradicted
    sure = consistent_fit(fit_of(unknowns, theta, np.eye(size), np.full(size, 50.0)))
    assert sure.contradicted


def test_bounds_that_contradict_one_another_are_named_and_no_others(chain, fit_of):
    robot = chain(boxes=[(SMALL,), ()])
    unknowns = unknowns_of(robot)
    fit = fit_of(unknowns, unknowns.cad, np.eye(unknowns.size), np.full(unknowns.size, 1e3))
    size = unknowns.size
    light = Bound("weighed: at most 3 kg", at(size, 0, 1.0), 3.0, "mass")
    heavy = Bound("weighed: at least 5 kg", at(size, 0, -1.0), -5.0, "mass")
    found = consistent_fit(fit, [light, heavy])
    assert found.theta is None
    assert {bound.words for bound in found.contradiction} == {light.words, heavy.words}
    # Three of them, none of which contradicts another one alone.
    x, y = unknowns.column(0), unknowns.column(0) + 1
    total = Bound("x + y of link0", at(size, [x, y], -1.0), -4.0 * 0.05, "link0 x")
    found = consistent_fit(fit, [total])
    assert {bound.words for bound in found.contradiction} == {
        "x + y of link0",
        "link0 CoM x at its upper bound 0.03 m of the box",
        "link0 CoM y at its upper bound 0 m of the box",
    }


def test_a_given_com_outside_its_box_is_named(chain, random_fit):
    """What robot.yaml puts below a cut is held to the box that the URDF draws there."""
    sole = box((0.0, 0.0, -0.1), (0.1, 0.1, 0.1))
    robot = chain(boxes=[(), (sole,)])
    below = BelowCut(2.0, robot.tree.coms[1])
    foot = Foot("left", "link1", "ft", None, np.eye(4), None)
    robot = replace(robot, sensors={"ft": Sensor("ft", "joint1", below=below)}, feet={"left": foot})
    found = consistent_fit(random_fit(2, 3, free_masses=False, robot=robot))
    assert found.theta is None
    assert [bound.words for bound in found.contradiction] == [
        "link1 CoM z at its upper bound -0.05 m of the box (given, not fitted)"
    ]


def test_noise_that_pushes_a_com_out_of_its_box_is_undone_and_the_total_com_stays(biped14):
    robot, rng = biped14.robot, np.random.default_rng(4)
    k = robot.tree.link_index["r_shin"]
    links = list(robot.tree.links)
    # As built, the CoM is 1 mm from the front of the shin; CAD has it in the middle.
    com = links[k].com
    shin = box((com[0] - 0.02, com[1], com[2]), (0.05, 0.1, 0.3))
    links[k] = replace(links[k], boxes=(shin,), com=com - np.array([0.02, 0.0, 0.0]))
    believed = replace(robot, tree=replace(robot.tree, links=tuple(links)))
    links[k] = replace(links[k], com=com + np.array([0.004, 0.0, 0.0]))
    built = replace(robot, tree=replace(robot.tree, links=tuple(links)))
    table = biped14.measure(true_robot=built)
    unknowns = unknowns_of(believed)
    standing = [pose for pose in biped14.plan if pose.support != NONE][::8]
    outside = 0
    for _ in range(6):
        fit = adjust(believed, unknowns, groups_of(believed, biped14.noisy(table, rng)))
        found = consistent_fit(fit)
        link = next(link for link in found.links if link.link == "r_shin")
        face = com[0] + 0.005
        assert link.com[0] <= face + 1e-8
        inputs, moved = cad_inputs(fit), replace(fit, theta=found.theta)
        for pose in standing:
            before, cov, _ = total_com_at(fit, inputs, pose.support, pose.q[None])
            after, _, _ = total_com_at(moved, inputs, pose.support, pose.q[None])
            sigma = np.sqrt(np.einsum("nii->ni", cov))
            assert (np.abs(after - before) < sigma).all()
        if link.before[0] > face + 1e-6:
            outside += 1
            assert link.com[0] == pytest.approx(face, abs=1e-7)
            assert link.source[0] == "bound"
            assert "r_shin CoM x at its upper bound" in found.active[0].bound.words
            assert not found.contradicted
    assert outside >= 1


def test_a_box_that_the_data_contradict_is_named(biped14):
    robot = biped14.robot
    k = robot.tree.link_index["torso"]
    links = list(robot.tree.links)
    com = links[k].com
    links[k] = replace(links[k], boxes=(box(com, (0.02, 0.2, 0.5)),))
    believed = replace(robot, tree=replace(robot.tree, links=tuple(links)))
    links[k] = replace(links[k], com=com + np.array([0.04, 0.0, 0.0]))
    built = replace(robot, tree=replace(robot.tree, links=tuple(links)))
    table = biped14.noisy(
        biped14.measure(biped14.plan[::2], true_robot=built), np.random.default_rng(1)
    )
    fit = adjust(believed, unknowns_of(believed), groups_of(believed, table))
    found = consistent_fit(fit)
    assert found.contradicted
    assert "torso CoM x at its upper bound" in found.active[0].bound.words
