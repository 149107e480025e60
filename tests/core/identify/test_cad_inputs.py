# SPDX-License-Identifier: Apache-2.0
"""An error of a value taken from CAD moves the fit as the propagated covariance says.

The oracle is the simulated world: a robot that differs in that one value is measured without noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.adjust import adjust
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.groups import groups_of
from comcal.identify.solution import total_com_at
from comcal.identify.unknowns import unknowns_of
from comcal.robot.draw import links_below_cuts
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of


@pytest.mark.parametrize("name", ["table1", "biped14"])
def test_covariance_from_cad_is_the_sum_over_robots_that_differ_in_one_value(
    name: str, request: pytest.FixtureRequest
) -> None:
    bench = request.getfixturevalue(name)
    robot = bench.robot
    unknowns = unknowns_of(robot)
    plan = bench.plan[::2]
    nominal = adjust(robot, unknowns, groups_of(robot, bench.measure(plan)))
    posture = bench.plan[3]
    expected, of_com = np.zeros_like(nominal.cov), np.zeros((3, 3))
    for k, link in enumerate(robot.tree.links):
        if not links_below_cuts(robot)[k]:  # what is left are yokes of 1 g, which do not count
            continue
        changed = [replace(link, com=link.com + 1e-3 * axis) for axis in np.eye(3)]
        changed.append(replace(link, mass=1.005 * link.mass))
        for other in changed:
            links = (*robot.tree.links[:k], other, *robot.tree.links[k + 1 :])
            true = replace(robot, tree=replace(robot.tree, links=links))
            fit = adjust(robot, unknowns, groups_of(robot, bench.measure(plan, true_robot=true)))
            error = fit.theta - nominal.theta
            error[0] -= other.mass - link.mass
            expected += np.outer(error, error)
            found, _, _ = total_com_at(fit, cad_inputs(fit), posture.support, posture.q[None])
            carrier = carrier_of(true, posture.support)
            truth = placed_in_stance(true, carrier, posture.q[None]).total_com()
            of_com += np.outer(found - truth, found - truth)
    cov = cad_inputs(nominal).cov
    size = np.sqrt(np.diag(expected)).max()
    np.testing.assert_allclose(cov, expected, rtol=0, atol=1e-3 * size**2)
    assert np.sqrt(cov[0, 0]) == pytest.approx(np.sqrt(expected[0, 0]), rel=1e-3)

    xyz_sigma = total_com_at(nominal, cad_inputs(nominal), posture.support, posture.q[None])[2]
    hidden = nominal.cov_cad
    unseen = total_com_at(
        replace(nominal, cov_cad=np.zeros_like(hidden)),
        cad_inputs(nominal),
        posture.support,
        posture.q[None],
    )[2]
    assert (np.diag(xyz_sigma[0]) >= np.diag(unseen[0]) - 1e-18).all()
    np.testing.assert_allclose(unseen[0], of_com, rtol=0, atol=2e-3 * of_com.max())
