# SPDX-License-Identifier: Apache-2.0
"""Readings that the model expects, and how residuals follow loads on links."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.expected import expected_readings
from comcal.diagnose.link_loads import link_loads
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed, Load
from comcal.predict.parity import parity
from comcal.robot.model import Robot


@pytest.fixture(scope="module")
def table(biped14) -> PoseTable:
    plan = biped14.plan
    kinds = ("double", "left", "right", "none")
    chosen = [p for s in kinds for p in [p for p in plan if p.support == s][:2]]
    return biped14.measure(chosen)


def test_expected_readings_leave_no_residual_whatever_was_read(biped14, table: PoseTable) -> None:
    rng = np.random.default_rng(1)
    nonsense = replace(
        table,
        wrench={s: 1e3 * rng.standard_normal(w.shape) for s, w in table.wrench.items()},
        torque=1e3 * rng.standard_normal(table.torque.shape),
    )
    expected = expected_readings(Assumed(biped14.robot), nonsense)
    assert np.nanmax(np.abs(parity(Assumed(biped14.robot), expected).values)) < 1e-6


def test_on_one_foot_expected_wrenches_are_those_of_the_world(biped14, table: PoseTable) -> None:
    expected = expected_readings(Assumed(biped14.robot), table)
    single = [s != "double" for s in table.support]
    for sensor, wrench in table.wrench.items():
        np.testing.assert_allclose(expected.wrench[sensor][single], wrench[single], atol=1e-5)


def test_columns_of_masses_and_forces_are_differences_of_the_residuals(
    biped14, table: PoseTable
) -> None:
    robot: Robot = biped14.robot
    assumed = Assumed(robot)
    at = parity(assumed, table)
    loads = link_loads(assumed, table, at)
    standing = np.array(table.support)[at.pose] != "none"
    for k, link in enumerate(robot.tree.links):
        force = replace(assumed, loads=(Load(k, np.array([1.0, -2.0, 3.0])),))
        moved = parity(force, table).values - at.values
        np.testing.assert_allclose(
            (loads.by_force[:, k] @ [1.0, -2.0, 3.0])[standing], moved[standing], atol=1e-8
        )
        heavier = replace(link, mass=link.mass + 1.0)
        links = (*robot.tree.links[:k], heavier, *robot.tree.links[k + 1 :])
        changed = replace(assumed, robot=replace(robot, tree=replace(robot.tree, links=links)))
        moved = parity(changed, table).values - at.values
        np.testing.assert_allclose(loads.by_weight[:, k] @ [1.0, *link.com], moved, atol=1e-8)
