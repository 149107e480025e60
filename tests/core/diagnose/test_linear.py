# SPDX-License-Identifier: Apache-2.0
"""Columns that are put together from elementary ones are those of the residuals themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.diagnose.candidates import Candidate, candidates
from comcal.diagnose.linear import Linear
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity

STEP = 1e-4
"""Of the differences, as a share of a fault."""


def differenced(candidate: Candidate, at: Linear) -> np.ndarray:
    """All residuals anew, once for each coordinate."""
    found = np.zeros((len(at.at.values), len(candidate.keys)))
    for k, size in enumerate(candidate.fault * STEP):
        step = np.zeros(len(candidate.keys))
        step[k] = size
        state = candidate.effect.correct(at.assumed, at.table, candidate.change(step))
        found[:, k] = np.nan_to_num(at.at.values - parity(*state).values) / size
    return found


def test_every_column_is_the_difference_of_all_residuals(biped14):
    """On both feet, on either, and hanging; on a floor that slopes, as on a level one."""
    exact = biped14.measure(biped14.plan[::7])
    table = biped14.noisy(exact, np.random.default_rng(2))
    assert {"double", "left", "right"} <= set(table.support)
    sloped = replace(Assumed(biped14.robot), floor=np.array([0.02, -0.03]))
    for assumed in (Assumed(biped14.robot), sloped):
        at = Linear(assumed, table)
        for candidate in candidates(biped14.robot, table):
            found, wanted = candidate.columns(at), differenced(candidate, at)
            scale = np.abs(wanted).max(axis=0) + 1e-9
            off = np.abs(found - wanted).max(axis=0) / scale
            assert (off < 2e-3).all(), (candidate.name, candidate.keys, off)


def test_an_angle_that_is_not_known_spoils_only_rows_that_follow_it(biped14):
    """A frozen encoder's readings are taken out; feet that do not feel the arm are still read."""
    exact = biped14.measure(biped14.plan[::7])
    table = biped14.noisy(exact, np.random.default_rng(2))
    q = table.q.copy()
    q[1:3, biped14.robot.tree.joint_names.index("r_shoulder")] = np.nan
    at = Linear(Assumed(biped14.robot), replace(table, q=q))
    known = np.isfinite(at.at.values)
    assert np.count_nonzero(known[np.isin(at.at.pose, (1, 2))]) > 0
    for candidate in candidates(biped14.robot, at.table):
        assert np.isfinite(candidate.columns(at)[known]).all(), candidate.name
