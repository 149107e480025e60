# SPDX-License-Identifier: Apache-2.0
"""A place is found by the evidence of a free value in every pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import catalogue
from comcal.diagnose.evidence import Explanation
from comcal.diagnose.naming import Named
from comcal.diagnose.places import FAULTS, SIZES, place_of
from comcal.diagnose.scene import Scene, scene
from comcal.predict.assumed import Assumed

JOINT = "l_knee"


@pytest.fixture(scope="module")
def about(biped14) -> Scene:
    """An encoder that errs by something else in every pose."""
    rng = np.random.default_rng(6)
    robot, plan = biped14.robot, [*biped14.plan[:32:3], *biped14.plan[36:38]]
    table = biped14.noisy(biped14.measure(plan), rng)
    q = table.q.copy()
    q[:, robot.tree.joint_names.index(JOINT)] += rng.normal(scale=0.02, size=len(table))
    table = replace(table, q=q)
    return scene(catalogue(candidates(robot, table), robot), (Assumed(robot), table))


def test_a_place_has_the_evidence_of_its_covariance_written_out(about: Scene) -> None:
    nothing = Explanation(0.0, np.zeros(0), np.zeros((0, 0)))
    found = place_of(Named((), about, nothing, (), 0.0))
    assert found is not None
    assert (found.place, found.target) == ("encoder", JOINT)
    k = about.at.assumed.robot.tree.joint_names.index(JOINT)
    free = about.by.turned(-FAULTS["encoder"] * about.at.slopes[:, [k]])[:, 0]
    own = free * (about.by.pose[:, None] == np.arange(len(about.at.table))).T
    T = about.X * about.of.spread({})
    healthy = np.eye(len(about.r)) + T @ T.T
    odds = [
        log_density(healthy + size**2 * own.T @ own, about.r) - log_density(healthy, about.r)
        for size in SIZES
    ]
    assert found.log_odds == pytest.approx(max(odds), rel=1e-8)


def log_density(cov: np.ndarray, r: np.ndarray) -> float:
    return -0.5 * float(r @ np.linalg.solve(cov, r) + np.linalg.slogdet(cov)[1])
