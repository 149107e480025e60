# SPDX-License-Identifier: Apache-2.0
"""Readings freed of loads leave the residuals that the same loads, assumed, leave of the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.predict.assumed import Assumed, Load
from comcal.predict.parity import parity
from comcal.predict.plain import plain_readings

LINKS = ("torso", "l_arm", "r_thigh", "l_shin", "l_foot", "r_sole")


@pytest.mark.parametrize("inertia", [0.0, 1.0])
def test_any_loads_inertia_and_imu_tilt_are_taken_out_of_any_readings(biped14, inertia) -> None:
    """Whatever is wrong besides: readings that balance nothing keep what they lack."""
    rng = np.random.default_rng(4)
    plan = [pose for i, pose in enumerate(biped14.plan) if i % 4 == 0 or pose.support == "none"]
    table = biped14.noisy(biped14.measure(plan), rng)
    joints = biped14.robot.tree.joint_names
    motion = {f"qdd.{joint}": rng.normal(0.0, 1.0, len(table)) for joint in joints}
    table = replace(table, motion=motion)
    loads = tuple(
        Load(
            biped14.robot.tree.link_index[link],
            rng.normal(0.0, 10.0, 3),
            point=rng.normal(0.0, 0.1, 3),
            stiffness=50.0 * np.eye(3),
            poses=frozenset(table.pose[::2]) if link == "l_shin" else None,
        )
        for link in LINKS
    )
    assumed = Assumed(
        biped14.robot,
        floor=np.array([0.01, -0.02]),
        loads=loads,
        imu_tilt=np.array([0.02, 0.01]),
        inertia=inertia,
    )
    plain = replace(assumed, loads=(), imu_tilt=np.zeros(2), inertia=0.0)
    expected, found = parity(assumed, table), parity(plain, plain_readings(assumed, table))
    assert {row.kind for row in found.row} == {"equilibrium", "sensor", "torque", "closure", "imu"}
    np.testing.assert_allclose(found.values, expected.values, atol=1e-9)
    assert np.nanmax(np.abs(parity(plain, table).values - expected.values)) > 5.0


def test_without_surroundings_readings_stay_as_they_are(biped14) -> None:
    table = biped14.measure(biped14.plan[:3])
    floor = Assumed(biped14.robot, floor=np.array([0.01, 0.0]), internal_torque=1.0)
    plain = plain_readings(floor, table)
    for sensor, wrench in table.wrench.items():
        np.testing.assert_array_equal(plain.wrench[sensor], wrench)
    np.testing.assert_array_equal(plain.torque, table.torque)
    np.testing.assert_allclose(plain.imu, table.imu, atol=1e-15)
