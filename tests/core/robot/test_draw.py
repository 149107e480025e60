# SPDX-License-Identifier: Apache-2.0
"""A drawn robot differs from its URDF by what its tolerances say, and in nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from comcal.robot.draw import draw_robot, links_below_cuts


def test_spread_of_drawn_robots_is_that_of_the_tolerances(table1) -> None:
    rng = np.random.default_rng(3)
    drawn = [draw_robot(table1.robot, rng).tree for _ in range(1000)]
    tree, tolerances = table1.robot.tree, table1.robot.tolerances
    coms = np.array([t.coms for t in drawn]) - tree.coms
    masses = np.array([t.masses for t in drawn]) / tree.masses - 1.0
    below = links_below_cuts(table1.robot)
    assert coms.std() == pytest.approx(tolerances.link_com, rel=0.03)
    assert np.abs(coms.mean(axis=0)).max() < 5 * tolerances.link_com / np.sqrt(1000)
    assert masses[:, below].std() == pytest.approx(tolerances.link_mass, rel=0.1)
    assert (masses[:, ~below] == 0.0).all()


def test_only_the_soles_of_a_biped_are_below_its_cuts(biped14) -> None:
    links = biped14.robot.tree.links
    below = {links[k].name for k in np.flatnonzero(links_below_cuts(biped14.robot))}
    assert below == {"l_sole", "r_sole"}


def test_same_generator_draws_the_same_robot(biped14) -> None:
    first, second = (draw_robot(biped14.robot, np.random.default_rng(8)).tree for _ in range(2))
    assert (first.coms == second.coms).all()
    assert (first.masses == second.masses).all()
    assert (first.coms != biped14.robot.tree.coms).any()
