# SPDX-License-Identifier: Apache-2.0
"""The sigma of a change is right although both calibrations share what CAD is off by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.differences import changes_between, comparable
from comcal.identify.groups import groups_of
from comcal.identify.unknowns import unknowns_of
from comcal.measure.table import PoseTable
from comcal.robot.draw import draw_robot
from comcal.robot.model import Robot


def fit_of(robot: Robot, table: PoseTable) -> Adjustment:
    return adjust(robot, unknowns_of(robot), groups_of(robot, table))


def test_unchanged_robots_change_by_their_sigma(biped14) -> None:
    """Pooled over robots off their URDF, noises and quantities; the two see different poses."""
    robot = biped14.robot
    rng = np.random.default_rng(11)
    double = np.array([p.support == "double" for p in biped14.plan])
    pulls: dict[str, list[float]] = {}
    for _ in range(8):
        table = biped14.measure(true_robot=draw_robot(robot, rng))
        few = table.select(double | (np.arange(len(double)) % 3 > 0))
        one, other = (fit_of(robot, biped14.noisy(t, rng)) for t in (table, few))
        q = table.q[0]
        for change in changes_between(one, other, "double", q):
            pulls.setdefault(change.kind, []).append(change.value / change.sigma)
    assert set(pulls) == {"mass", "link", "sum", "total_com"}
    everything = np.concatenate(list(pulls.values()))
    assert float(np.std(everything)) == pytest.approx(1.0, abs=0.15)
    assert float(np.std(pulls["total_com"])) == pytest.approx(1.0, abs=0.35)


def test_what_cad_does_to_both_alike_cancels(biped14) -> None:
    loose = replace(biped14.robot.tolerances, link_com=0.05, link_mass=0.1)
    robot = replace(biped14.robot, tolerances=loose)
    table = biped14.noisy(biped14.measure(), np.random.default_rng(12))
    tight, wide = fit_of(biped14.robot, table), fit_of(robot, table)
    q = table.q[0]
    for a, b in zip(
        changes_between(tight, tight, "double", q),
        changes_between(wide, wide, "double", q),
        strict=True,
    ):
        assert b.sigma == pytest.approx(a.sigma, rel=1e-9)


def test_fits_of_another_urdf_are_not_compared_in_full(biped14) -> None:
    table = biped14.measure()
    links = list(biped14.robot.tree.links)
    links[0] = replace(links[0], com=links[0].com + 0.001)
    other = replace(biped14.robot, tree=replace(biped14.robot.tree, links=tuple(links)))
    one = fit_of(biped14.robot, table)
    assert comparable(one, one)
    assert not comparable(one, fit_of(other, table))
