# SPDX-License-Identifier: Apache-2.0
"""Poses that are named and not fitted, and sensors that do not carry the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.identify.cut_errors import cut_errors, masses_below
from comcal.identify.scope import Scope, scoped
from comcal.identify.solution import solve_all

EVERYTHING = Scope(free_masses=True, unknown_tares=True)


def test_errors_stand_in_the_channels_of_the_sensor(biped14):
    """A reading that is wrong by a known wrench is off by that wrench, in its own frame."""
    robot, table = biped14.robot, biped14.measure()
    off = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
    wrong = replace(table, wrench={**table.wrench, "r_foot": table.wrench["r_foot"] + off})
    unknowns, groups = scoped(robot, wrong, EVERYTHING)
    found = [
        cut_errors(robot, unknowns, group, unknowns.cad)["r_foot"]
        for group in groups
        if any(cut.sensor == "r_foot" for cut in group.layout.cuts)
    ]
    assert found
    np.testing.assert_allclose(np.concatenate(found) - off, 0.0, atol=1e-8)


def test_named_poses_are_predicted_and_touch_nothing_that_is_fitted(biped14):
    robot, clean = biped14.robot, biped14.measure()
    noisy = biped14.noisy(clean, np.random.default_rng(2))
    late = np.arange(len(clean)) % 3 == 0
    early = noisy.select(~late)
    honest, spoilt = (
        solve_all(robot, early, EVERYTHING, held_out=replace(part, wrench=wrench))
        for part in [noisy.select(late)]
        for wrench in (part.wrench, {s: w + 5.0 for s, w in part.wrench.items()})
    )
    np.testing.assert_array_equal(honest.adjustment.theta, spoilt.adjustment.theta)
    assert honest.held_out.chosen
    assert honest.held_out.rank_lost == 0
    assert honest.held_out.poses == sum(s != "none" for s in noisy.select(late).support)
    assert spoilt.held_out.force_rms > 3.0 > honest.held_out.force_rms
    for good, bad in zip(honest.held_out.cuts, spoilt.held_out.cuts, strict=True):
        np.testing.assert_allclose(bad.force, 5.0, rtol=0.3)
        assert (good.force < 1.0).all()


def test_a_tare_that_was_taken_is_not_looked_for(biped14):
    table = replace(biped14.measure(), tare_cov={"l_foot": 0.01 * np.eye(6)})
    unknowns, _ = scoped(biped14.robot, table, Scope(unknown_tares=True))
    assert "r_foot" in unknowns.offsets
    assert "l_foot" not in unknowns.offsets


@pytest.mark.parametrize("free_masses", [True, False])
def test_masses_below_cuts_are_those_of_free_links_only(biped14, free_masses):
    scope = Scope(free_masses=free_masses, unknown_tares=True)
    found = solve_all(biped14.robot, biped14.measure(), scope, links_only=True)
    feet = {foot.sensor for foot in biped14.robot.feet.values()}
    below = masses_below(found.adjustment)
    assert not feet & {mass.sensor for mass in below}  # what hangs below a foot's cut is the URDF's
    assert free_masses or not below
