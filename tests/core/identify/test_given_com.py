# SPDX-License-Identifier: Apache-2.0
"""Total CoMs known by other means, sessions that hang, and sessions that mix all of it."""

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import RankError
from comcal.identify.calibration import Method, Verdict, calibrate
from comcal.identify.paper_route import paper_route
from comcal.identify.solution import solve_all
from comcal.measure.plan import NONE
from comcal.robot.model import Limits
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of

THIGHS = (2 * 1.16 * -0.02) / 3.26
TRUTH = np.array([0.2 + 0.01j, 0.32208589 + 1j * THIGHS])


def shapes(bench):
    """One pose of every shape, and its wrenches."""
    plan = [p for p in bench.plan if p.configuration]
    first = {p.configuration: p for p in reversed(plan)}
    return bench.measure(list(first.values())[::-1])


def with_com(bench, table, link=None, true_robot=None):
    """The CoM of the whole robot given, in P or in the frame of a link, and no wrench."""
    robot = true_robot or bench.robot
    at = placed_in_stance(robot, carrier_of(robot, "double"), table.q)
    com = at.total_com()
    if link is not None:
        R, p = at.link(link)
        com = np.einsum("nji,nj->ni", R, com - p)
    empty = {s: np.full_like(w, np.nan) for s, w in table.wrench.items()}
    var = np.full(com.shape, 1e-8)
    return replace(table, com=com, com_var=var, wrench=empty, com_frame=link or "P")


@pytest.mark.parametrize("frame", [None, "l_shin", "waist"])
def test_coms_given_in_p_or_in_a_link_are_solved(frame, skewed):
    table = with_com(skewed, shapes(skewed), frame)
    found = calibrate(skewed.robot, table)
    assert found.solution is None
    assert found.coefficients is None
    assert found.paper is not None
    np.testing.assert_allclose(found.paper.choices[0].w, TRUTH, atol=1e-8)
    assert found.verdict is Verdict.NO_LIMITS
    assert "all-data route" in found.reason
    unlimited = replace(skewed.robot, limits=Limits())
    assert calibrate(unlimited, table).reason == ""


def test_a_robot_without_force_sensors_is_solved_from_given_coms(skewed):
    table = with_com(skewed, shapes(skewed))
    feet = {n: replace(f, sensor=None) for n, f in skewed.robot.feet.items()}
    robot = replace(skewed.robot, feet=feet, sensors={})
    at = placed_in_stance(robot, carrier_of(skewed.robot, "double"), table.q)
    bare = replace(table, com=at.total_com(), wrench={}, wrench_cov={})
    np.testing.assert_allclose(calibrate(robot, bare).paper.choices[0].w, TRUTH, atol=1e-8)


def test_a_given_com_without_y_says_nothing_about_y(skewed):
    table = with_com(skewed, shapes(skewed))
    com, var = table.com.copy(), table.com_var.copy()
    com[:, 1] = var[:, 1] = np.nan
    found = paper_route(skewed.robot, replace(table, com=com, com_var=var))
    np.testing.assert_allclose(found.choices[0].w, TRUTH, atol=1e-8)
    for total in found.totals:
        assert np.isnan(total.xyz).tolist() == [False, True, False]
        assert np.isnan(total.cov[1]).all()
        assert np.isfinite(total.cov[np.ix_([0, 2], [0, 2])]).all()
    assert np.isfinite(found.choices[0].cov).all()
    link = replace(with_com(skewed, shapes(skewed), "waist"), com=com)
    assert not paper_route(skewed.robot, link).totals


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_an_error_that_is_not_stated_is_unknown_and_not_zero(value, skewed):
    table = with_com(skewed, shapes(skewed))
    found = paper_route(skewed.robot, replace(table, com_var=np.full((3, 3), value)))
    np.testing.assert_allclose(found.choices[0].w, TRUTH, atol=1e-8)
    assert np.isnan(found.choices[0].cov).all()
    assert np.isnan(found.totals[0].cov).all()


@pytest.mark.parametrize("frame", [None, "waist"])
def test_links_from_given_coms_scatter_as_they_say(frame, skewed):
    robot = skewed.robot
    table = with_com(skewed, shapes(skewed), frame)
    table = replace(table, com_var=np.tile([1e-8, 4e-8, 9e-8], (3, 1)))
    rng, tolerances = np.random.default_rng(3), robot.tolerances
    exact = replace(robot, tolerances=replace(tolerances, link_com=0.0, link_mass=0.0))
    best = paper_route(exact, table).choices[0]
    w = []
    for _ in range(100):
        com = table.com + np.sqrt(table.com_var) * rng.standard_normal(table.com.shape)
        q = table.q + np.sqrt(table.q_cov) * rng.standard_normal(table.q.shape)
        drawn = paper_route(exact, replace(table, com=com, q=q)).choices
        same = next(c for c in drawn if c.choice.solving == best.choice.solving)
        w.append(np.stack([same.w.imag, same.w.real], axis=1).ravel())
    # 100 draws: a standard deviation is uncertain by 7 %.
    assert np.abs(np.std(w, axis=0) / np.sqrt(np.diag(best.cov)) - 1).max() < 0.3
    # An error of x in P, in whatever frame the CoM is given.
    in_P = paper_route(exact, with_com(skewed, shapes(skewed))).choices[0]
    np.testing.assert_allclose(best.noise_gain, in_P.noise_gain, rtol=1e-6)


@pytest.mark.parametrize("given", [True, False])
def test_cad_of_the_feet_enters_as_its_covariance_says(given, skewed):
    """A robot whose feet differ from CAD in one number moves the answer by that number's sigma."""
    robot = skewed.robot

    def answer(true, told=robot):
        if given:
            table = with_com(skewed, shapes(skewed), true_robot=true)
        else:
            plan = [p for p in skewed.plan if p.configuration]
            table = skewed.measure(plan, true_robot=true)
        choices = paper_route(told, table).choices
        best = next(c for c in choices if c.choice.solving == (0, 1))
        return np.stack([best.w.imag, best.w.real], axis=1).ravel(), best.cov

    nominal, cov = answer(robot)
    expected = np.zeros((4, 4))
    for foot in ("l_foot", "r_foot"):
        k = robot.tree.link_index[foot]
        link = robot.tree.links[k]
        changed = [replace(link, com=link.com + d) for d in 1e-3 * np.eye(3)[[0, 2]]]
        changed.append(replace(link, mass=1.005 * link.mass))
        for other in changed:
            links = (*robot.tree.links[:k], other, *robot.tree.links[k + 1 :])
            off = answer(replace(robot, tree=replace(robot.tree, links=links)))[0] - nominal
            expected += np.outer(off, off)
    tolerances = replace(robot.tolerances, link_com=0.0, link_mass=0.0)
    _, noise = answer(robot, replace(robot, tolerances=tolerances))
    sigma = np.sqrt(np.diag(cov - noise))
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(expected)), rtol=0.02, atol=1e-6)


def test_a_session_with_coms_and_wrenches_uses_each_where_it_is(skewed):
    """Cramer starts from given CoMs; all data takes the poses that have a wrench."""
    robot, measured = skewed.robot, skewed.measure()
    first = {name: i for i, name in reversed(list(enumerate(measured.configuration))) if name}
    given = sorted(first.values())
    others = [i for i in range(len(measured)) if i not in given]
    com = with_com(skewed, measured)
    table = replace(measured, com=measured.com.copy(), com_var=measured.com_var.copy())
    table.com[given], table.com_var[given] = com.com[given], com.com_var[given]
    wrench = {s: w.copy() for s, w in measured.wrench.items()}
    for w in wrench.values():
        w[given] = np.nan
    found = calibrate(robot, replace(table, wrench=wrench))
    assert found.paper is not None
    assert found.solution is not None
    assert found.coefficients is not None
    assert {t.by for t in found.paper.totals} == {"given"}
    np.testing.assert_allclose(found.paper.choices[0].w, TRUTH, atol=1e-8)
    assert found.difference is None
    assert list(found.coefficients.rows) == others
    alone = solve_all(robot, measured.select(others)).adjustment
    np.testing.assert_allclose(found.solution.adjustment.theta, alone.theta, atol=1e-12)
    # Where the CoM was given it is predicted by the fit, wrench or not.
    assert len(found.solution.poses) == len(measured)
    for i in given:
        np.testing.assert_allclose(found.solution.poses[i].xyz, com.com[i], atol=1e-6)


@pytest.mark.parametrize("method", list(Method))
def test_a_session_that_only_hangs_says_so(method, table1):
    table = table1.measure(table1.plan[:3])
    table = replace(table, support=(NONE,) * 3)
    if method is Method.BOTH:
        found = calibrate(table1.robot, table)
        assert found.verdict is Verdict.NOT_IDENTIFIABLE
        assert "held in every pose" in found.reason
        return
    with pytest.raises(RankError) as caught:
        calibrate(table1.robot, table, method)
    assert "given CoMs" not in caught.value.what
    assert caught.value.next_step


def test_a_session_of_centres_of_pressure_alone_says_what_is_missing(table1):
    table = table1.measure(table1.plan[:4])
    empty = {s: np.full_like(w, np.nan) for s, w in table.wrench.items()}
    cop = np.full((4, 2), 0.01)
    found = calibrate(table1.robot, replace(table, wrench=empty, cop=cop))
    assert found.verdict is Verdict.NOT_IDENTIFIABLE
    assert "no standing pose has a wrench" in found.reason
