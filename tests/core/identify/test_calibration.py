# SPDX-License-Identifier: Apache-2.0
"""Both routes together: they agree within their own sigma, and the verdict follows the limits."""

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import RankError
from comcal.identify.adjust import adjust
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.calibration import Method, Verdict, calibrate
from comcal.identify.difference import route_difference
from comcal.identify.groups import groups_of
from comcal.identify.paper_route import paper_route
from comcal.identify.solution import solve_all, total_com_at
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import PlannedPose
from comcal.robot.model import Limits
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of
from comcal_sims.robots.table1 import Table1Parameters, planar_twin_plan


def test_both_routes_differ_as_much_as_their_own_sigma_says(table1):
    rng = np.random.default_rng(7)
    plan = [p for p in table1.plan if p.configuration]
    clean = table1.measure(plan)
    robot = replace(
        table1.robot, tolerances=replace(table1.robot.tolerances, link_com=0.0, link_mass=0.0)
    )
    p = []
    for _ in range(50):
        table = table1.noisy(clean, rng)
        fit = adjust(robot, unknowns_of(robot), groups_of(robot, table))
        p.append(route_difference(fit, paper_route(robot, table), table).p)
    # Uniform between 0 and 1 when the sigma of the difference is right.
    assert 0.35 < np.mean(p) < 0.65
    assert min(p) > 1e-4


def test_a_wrong_foot_in_cad_moves_cramer_and_not_the_all_data_route(table1):
    links = tuple(
        replace(link, com=link.com + np.array([0.01, 0, 0])) if link.name.endswith("foot") else link
        for link in table1.robot.tree.links
    )
    wrong = replace(table1.robot, tree=replace(table1.robot.tree, links=links))
    table = table1.measure()
    paper = paper_route(wrong, table)
    fit = solve_all(wrong, table).adjustment
    difference = route_difference(fit, paper, table)
    assert np.abs(difference.lstsq[[1, 3]] - [0.2, 0.32208589]).max() < 1e-8
    assert np.abs(difference.cramer - difference.lstsq).max() > 0.005
    assert not difference.agree


@pytest.mark.parametrize("name", ["table1", "biped14"])
def test_total_com_at_a_posture_is_that_of_the_tree(name, request):
    bench = request.getfixturevalue(name)
    fit = solve_all(bench.robot, bench.measure()).adjustment
    for pose in bench.plan[:20:5]:
        xyz, _, _ = total_com_at(fit, cad_inputs(fit), pose.support, pose.q[None])
        carrier = carrier_of(bench.robot, pose.support)
        at = placed_in_stance(bench.robot, carrier, pose.q[None])
        np.testing.assert_allclose(xyz, at.total_com(), atol=1e-9)


@pytest.mark.parametrize(("name", "link"), [("table1", "waist"), ("biped14", "torso")])
def test_total_com_is_right_although_a_link_weighs_more_than_in_cad(name, link, request):
    bench = request.getfixturevalue(name)
    links = tuple(
        replace(k, mass=k.mass + 1.0) if k.name == link else k for k in bench.robot.tree.links
    )
    true = replace(bench.robot, tree=replace(bench.robot.tree, links=links))
    fit = solve_all(bench.robot, bench.measure(true_robot=true)).adjustment
    for pose in bench.plan[:20:5]:
        xyz, _, _ = total_com_at(fit, cad_inputs(fit), pose.support, pose.q[None])
        at = placed_in_stance(true, carrier_of(true, pose.support), pose.q[None])
        np.testing.assert_allclose(xyz, at.total_com(), atol=1e-9)


def test_links_below_a_cut_are_marked_as_prior_and_never_as_measured(biped14):
    solution = solve_all(biped14.robot, biped14.measure())
    below = {"l_sole", "r_sole"}
    for link in solution.links:
        assert (set(link.source) == {"prior"}) == (link.link in below or link.mass < 0.005)
        assert np.isnan(link.com[~link.identifiable]).all() or "prior" in link.source


def test_the_held_out_error_is_that_of_the_noise(biped14):
    table = biped14.noisy(biped14.measure(), np.random.default_rng(1))
    held = solve_all(biped14.robot, table).held_out
    assert held.poses == 37
    assert held.rank_lost == 0
    # 0.02 deg of encoder over half a metre, 0.01 N m over 628 N: fractions of a millimetre.
    assert 0.1e-3 < held.com_rms < 1.5e-3
    assert held.com_rms < held.com_upper


@pytest.mark.parametrize(
    ("limits", "verdict"),
    [
        (Limits(), Verdict.NO_LIMITS),
        (Limits(com_error=0.005, mass_error=0.5), Verdict.PASSED),
        (Limits(com_error=1e-6), Verdict.FAILED),
        (Limits(mass_error=1e-9), Verdict.FAILED),
    ],
)
def test_the_verdict_follows_the_limits(limits, verdict, table1):
    robot = replace(table1.robot, limits=limits)
    table = table1.noisy(table1.measure(), np.random.default_rng(1))
    assert calibrate(robot, table).verdict is verdict


def test_one_configuration_only_is_not_identifiable_and_names_a_pose(table1):
    plan = [p for p in table1.plan if p.configuration == "straight"]
    found = calibrate(table1.robot, table1.measure(plan))
    assert found.verdict is Verdict.NOT_IDENTIFIABLE
    assert "would show it" in found.reason or "bend" in found.reason


def test_one_pose_repeated_is_not_identifiable(table1):
    plan = [PlannedPose(i, table1.pose()) for i in range(1, 8)]
    found = calibrate(table1.robot, table1.measure(plan))
    assert found.verdict is Verdict.NOT_IDENTIFIABLE


def test_cramer_alone_refuses_a_session_without_twins(biped14):
    with pytest.raises(RankError, match="Cramer's rule does not apply"):
        calibrate(biped14.robot, biped14.measure(), Method.CRAMER)


def test_noise_gain_predicts_what_an_error_of_alpha_does(table1):
    plan = planar_twin_plan(Table1Parameters(), bend=0.4, tilt=0.4)
    clean = table1.measure(plan)
    rng, weight = np.random.default_rng(3), 18.4 * 9.81
    best = paper_route(table1.robot, clean).choices[0]
    off = []
    for _ in range(40):
        w = {s: v.copy() for s, v in clean.wrench.items()}
        # An alpha error of 0.1 mm is a moment error about y, here given to one foot.
        w["l_foot"][:, 4] -= weight * 1e-4 * rng.standard_normal(len(plan))
        found = paper_route(table1.robot, replace(clean, wrench=w))
        same = next(c for c in found.choices if c.choice.solving == best.choice.solving)
        off.append(np.stack([same.w.imag, same.w.real], axis=1).ravel())
    ratio = np.std(off, axis=0) / (1e-4 * best.noise_gain)
    # 40 draws: a standard deviation is uncertain by 11 %.
    assert np.abs(ratio - 1).max() < 0.4
