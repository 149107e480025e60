# SPDX-License-Identifier: Apache-2.0
"""A foot that stands elsewhere: against closed forms on the 14-joint robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.effects.registry import corrected
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes import Change


def rows(assumed: Assumed, table: PoseTable, kind: str) -> np.ndarray:
    """Residuals of one kind, shape (poses, axes)."""
    found = parity(assumed, table)
    values = [v for v, r in zip(found.values, found.row, strict=True) if r.kind == kind]
    poses = {int(i) for i, r in zip(found.pose, found.row, strict=True) if r.kind == kind}
    return np.array(values).reshape(len(poses), -1)


def placed(assumed: Assumed, table: PoseTable, foot: str, **keys: float) -> Assumed:
    return corrected(assumed, table, [Change("foot_placement", foot, keys)])[0]


@pytest.fixture(scope="module")
def both(biped14) -> PoseTable:
    return biped14.measure([p for p in biped14.plan if p.support == "double"][:6])


@pytest.fixture(scope="module")
def on_left(biped14) -> PoseTable:
    return biped14.measure([p for p in biped14.plan if p.support == "left"][:4])


def test_a_lean_of_the_right_foot_is_the_opposite_lean_of_its_floor(biped14, both):
    """z of the floor under it is Ry(-pitch) Rx(-roll) e_z to first order."""
    roll, pitch = 2e-5, -3e-5
    closure = rows(
        placed(Assumed(biped14.robot), both, "right", roll=roll, pitch=pitch), both, "closure"
    )
    np.testing.assert_allclose(closure[0, :2], [-roll, -pitch], atol=1e-9)
    # Feet that stand one before the other turn P, not the size of the lean.
    size = np.linalg.norm(closure[:, :2], axis=1)
    np.testing.assert_allclose(size, np.hypot(roll, pitch), rtol=1e-4)


@pytest.mark.parametrize(("foot", "sign"), [("right", -1.0), ("left", 1.0)])
def test_a_foot_on_a_shim_has_its_floor_lower(biped14, both, foot: str, sign: float):
    closure = rows(placed(Assumed(biped14.robot), both, foot, z=0.004), both, "closure")
    np.testing.assert_allclose(closure[:, 2], sign * 0.004, atol=1e-9)
    np.testing.assert_allclose(closure[:, :2], 0.0, atol=1e-9)


def test_on_one_foot_a_lean_is_a_slope_of_its_floor_seen_from_the_sole(biped14, on_left):
    """The floor under a sole that leans by T is T^-1: the world as if it sloped that way."""
    robot, tilt = biped14.robot, {"roll": 0.01, "pitch": -0.02}
    leaning = placed(Assumed(robot), on_left, "left", **tilt)
    weight = robot.gravity * float(
        robot.tree.masses[~robot.below_cut[str(robot.feet["left"].sensor)]].sum()
    )
    left = rows(leaning, on_left, "equilibrium")
    # What the forces say is upright now leans in P by T against the floor's normal.
    up = np.array([np.sin(-0.02) * np.cos(0.01), -np.sin(0.01), np.cos(-0.02) * np.cos(0.01)])
    expected = weight * (up - np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.abs(left[:, :3]), np.tile(np.abs(expected), (4, 1)), atol=1e-6)
    imu = rows(leaning, on_left, "imu")
    np.testing.assert_allclose(np.abs(imu), np.tile([0.01, 0.02], (4, 1)), rtol=1e-3)


def test_place_in_the_plane_of_the_floor_is_not_seen_by_feet_with_sensors(biped14, both, on_left):
    for table in (both, on_left):
        assumed = Assumed(biped14.robot)
        before = parity(assumed, table).values
        for key in ("x", "y"):
            after = parity(placed(assumed, table, "left", **{key: 0.02}), table).values
            np.testing.assert_allclose(after, before, atol=1e-10)
    turned = parity(placed(Assumed(biped14.robot), both, "left", yaw=0.05), both).values
    np.testing.assert_allclose(turned, parity(Assumed(biped14.robot), both).values, atol=1e-10)


def test_yaw_is_seen_by_one_foot_on_a_slope(biped14):
    """P turns with the sole: the slope that is known there then points elsewhere."""
    plan = [replace(p, floor_pitch=0.05) for p in biped14.plan if p.support == "left"][:2]
    table = biped14.measure(plan)
    known = Assumed(biped14.robot, floor=np.array([0.0, 0.05]))
    assert np.abs(rows(known, table, "equilibrium")).max() < 1e-9
    turned = rows(placed(known, table, "left", yaw=0.1), table, "equilibrium")
    weight = np.linalg.norm(table.wrench["l_foot"][0, :3])
    assert np.abs(turned[0, 1]) == pytest.approx(weight * np.sin(0.05) * np.sin(0.1), rel=1e-3)


def test_two_placements_of_one_foot_add_up(biped14, both):
    assumed = Assumed(biped14.robot)
    twice = placed(placed(assumed, both, "right", z=0.001), both, "right", z=0.002)
    once = placed(assumed, both, "right", z=0.003)
    np.testing.assert_allclose(parity(twice, both).values, parity(once, both).values, atol=1e-10)
