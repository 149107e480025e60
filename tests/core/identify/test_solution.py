# SPDX-License-Identifier: Apache-2.0
"""What the all-data route reports of links and postures, and with which errors."""

from dataclasses import replace

import numpy as np
import pytest

from comcal.errors import DataError
from comcal.identify.adjust import adjust
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.groups import groups_of
from comcal.identify.held_out import prediction_errors
from comcal.identify.solution import rotated_moment_functional, solve_all, total_com_at
from comcal.identify.unknowns import unknowns_of
from comcal.measure.plan import PlannedPose
from comcal.robot.draw import draw_robot
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Link
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of


def test_encoders_of_a_posture_add_what_they_do_to_its_com(biped14):
    robot = biped14.robot
    table = biped14.measure(biped14.plan[::2])
    q_cov = np.random.default_rng(1).uniform(1e-7, 1e-6, table.q_cov.shape)
    solution = solve_all(robot, replace(table, q_cov=q_cov))
    fit = solution.adjustment
    for found in solution.poses[::6]:
        q, support = table.q[found.row], table.support[found.row]
        carrier = carrier_of(robot, support)
        J = np.zeros((3, len(q)))
        for j, step in enumerate(1e-5 * np.eye(len(q))):
            ahead, back = (
                placed_in_stance(robot, carrier, (q + sign * step)[None]).total_com()[0]
                for sign in (1, -1)
            )
            J[:, j] = (ahead - back) / 2e-5
        xyz, cov, _ = total_com_at(fit, cad_inputs(fit), support, q[None])
        np.testing.assert_allclose(found.xyz, xyz[0])
        encoders = (J * q_cov[found.row]) @ J.T
        np.testing.assert_allclose(found.cov - cov[0], encoders, rtol=1e-3, atol=1e-12)
        assert np.sqrt(np.diag(encoders)[:2]).max() > 1e-4


def test_carried_and_whole_com_are_those_of_the_tree(biped14):
    robot, table = biped14.robot, biped14.measure()
    heights = [np.zeros(3), np.zeros(3)]
    for found in solve_all(robot, table).poses[::5]:
        carrier = carrier_of(robot, table.support[found.row])
        at = placed_in_stance(robot, carrier, table.q[found.row][None])
        masses = robot.tree.masses * carrier.carried
        np.testing.assert_allclose(found.carried_xyz, masses @ at.coms[0] / masses.sum(), atol=1e-8)
        np.testing.assert_allclose(found.xyz, at.total_com()[0], atol=1e-8)
        heights = [heights[0] + found.xyz, heights[1] + found.carried_xyz]
    assert np.abs(heights[0] - heights[1]).max() > 1e-4


def test_prediction_errors_are_those_of_the_wrench_and_of_the_line(odd):
    """Of a model that is wrong, without any fitting; by hand in the root frame."""
    rng = np.random.default_rng(5)
    robot = odd.odd_biped(rng)
    q = rng.normal(0, 0.3, (4, len(robot.tree.joint_names)))
    plan = [PlannedPose(i, p, "left", floor_pitch=0.1) for i, p in enumerate(q)]
    (group,) = groups_of(robot, odd.ideal_table(robot, plan))
    unknowns = unknowns_of(robot)
    theta = unknowns.cad + rng.normal(0, 0.05, unknowns.size)
    theta[0] += 0.3
    distance, force, moment = prediction_errors(robot, unknowns, group, theta)
    h, at = unknowns.moments(theta), place_links(robot.tree, q)
    R, p = at.joint("l_ft")
    for i in range(4):
        F = R[i] @ group.w[i, 0, :3]
        M = R[i] @ group.w[i, 0, 3:] + np.cross(p[i], F)
        above = np.flatnonzero(group.carrier.carried)
        S = sum(robot.tree.masses[k] * at.p[i, k] + at.R[i, k] @ h[k] for k in above)
        mass = theta[0] - group.below_mass
        up = F / np.linalg.norm(F)
        assert force[i] == pytest.approx(abs(np.linalg.norm(F) - mass * robot.gravity))
        off = M - robot.gravity * np.cross(S, up)
        assert moment[i] == pytest.approx(np.linalg.norm(off))
        # The line of gravity: all points r with r x F = M.
        point = np.cross(F, M) / (F @ F)
        away = S / mass - point
        assert distance[i] == pytest.approx(np.linalg.norm(away - (away @ up) * up), rel=1e-6)
    assert moment.min() > 0.01
    assert distance.min() > 1e-4


def test_moments_of_free_and_given_links_add_up(odd):
    rng = np.random.default_rng(2)
    robot = odd.odd_biped(rng)
    unknowns = unknowns_of(robot)
    theta = unknowns.cad + rng.normal(0, 0.1, unknowns.size)
    h = unknowns.moments(theta)
    links = tuple(robot.tree.link_index[n] for n in ("l_sole", "torso", "hand"))
    R = rng.normal(size=(len(robot.tree.links), 3, 3))
    L, known = rotated_moment_functional(unknowns, links, R)
    np.testing.assert_allclose(L @ theta + known, sum(R[k] @ h[k] for k in links))
    assert np.abs(known).max() > 0


def test_cad_sigma_is_the_scatter_of_healthy_robots(odd):
    """Of the unknowns as robots are drawn; the mass of links above the cuts is told there."""
    rng = np.random.default_rng(3)
    robot = odd.odd_biped(rng)
    unknowns = unknowns_of(robot)
    drawn = [replace(unknowns, robot=draw_robot(robot, rng)).cad for _ in range(400)]
    # 400 draws: a standard deviation is uncertain by 3.5 %.
    ratio = np.std(drawn, axis=0) / unknowns.cad_sigma
    assert np.abs(ratio[1:] - 1).max() < 0.16
    every = robot.tolerances.link_mass * np.linalg.norm(robot.tree.masses)
    assert unknowns.cad_sigma[0] == pytest.approx(every)


def test_a_pure_frame_has_no_com(table1):
    nothing = Link("marker", 0.0, np.zeros(3), np.zeros((3, 3)), has_inertial=False)
    tree = table1.robot.tree
    tip = replace(tree.joints[-1], name="tip", parent=tree.links[0].name, child="marker")
    tree = replace(tree, links=(*tree.links, nothing), joints=(*tree.joints, tip))
    robot = replace(table1.robot, tree=tree)
    marker = solve_all(robot, table1.measure()).links[-1]
    assert marker.link == "marker"
    assert marker.source == (None, None, None)
    assert np.isnan(marker.com).all()
    assert np.isnan(marker.cov).all()


def test_channels_that_are_one_and_the_same_are_refused(table1):
    """Perfectly correlated errors would leave a sum of forces and moments exact."""
    table = table1.measure()
    cov = {}
    for name, c in table.wrench_cov.items():
        c = c.copy()
        c[2, :, :] = np.outer(np.sqrt(np.diag(c[2])), np.sqrt(np.diag(c[2])))
        cov[name] = c
    exact = replace(table, wrench_cov=cov, q_cov=np.zeros_like(table.q_cov))
    with pytest.raises(DataError, match=r"\(pose 3\).*exact") as caught:
        adjust(table1.robot, unknowns_of(table1.robot), groups_of(table1.robot, exact))
    assert "noise in robot.yaml" in caught.value.next_step
