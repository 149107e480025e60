# SPDX-License-Identifier: Apache-2.0
"""An error of a value taken from CAD moves the fit as the propagated covariance says.

The oracle is the simulated world: a robot that differs in that one value is measured without noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.adjust import adjust
from comcal.identify.cad_inputs import cad_input_cov
from comcal.identify.linearise import groups_of
from comcal.identify.unknowns import unknowns_of
from comcal.robot.draw import links_below_cuts


@pytest.mark.parametrize("name", ["table1", "biped14"])
def test_covariance_from_cad_is_the_sum_over_robots_that_differ_in_one_value(
    name: str, request: pytest.FixtureRequest
) -> None:
    bench = request.getfixturevalue(name)
    robot = bench.robot
    unknowns = unknowns_of(robot)
    plan = bench.plan[::2]
    nominal = adjust(robot, unknowns, groups_of(robot, bench.measure(plan)))
    expected = np.zeros_like(nominal.cov)
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
    cov = cad_input_cov(nominal)
    size = np.sqrt(np.diag(expected)).max()
    np.testing.assert_allclose(cov, expected, rtol=0, atol=1e-3 * size**2)
    assert np.sqrt(cov[0, 0]) == pytest.approx(np.sqrt(expected[0, 0]), rel=1e-3)
