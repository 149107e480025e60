# SPDX-License-Identifier: Apache-2.0
"""Parity residuals: zero on the robot that is assumed, blind to the split between two feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed, Load
from comcal.predict.parity import Parity, parity
from comcal.robot.kinematics import place_links


def largest(found: Parity) -> dict[str, float]:
    """The largest residual of every kind."""
    kinds: dict[str, float] = {}
    for value, row in zip(found.values, found.row, strict=True):
        kinds[row.kind] = max(kinds.get(row.kind, 0.0), abs(float(value)))
    return kinds


@pytest.fixture(scope="module")
def table(biped14) -> PoseTable:
    return biped14.measure()


def test_all_rows_vanish_on_the_true_robot(biped14, table):
    found = parity(Assumed(biped14.robot), table)
    kinds = largest(found)
    assert set(kinds) == {"equilibrium", "sensor", "torque", "closure", "imu"}
    assert max(kinds.values()) < 1e-10
    assert len(found.values) == len(found.row) == len(found.pose)
    assert set(found.pose) == set(range(len(table)))


def test_how_two_feet_share_the_load_moves_neither_equilibrium_nor_closure(biped14, table):
    """Any wrench pressed into one foot and taken out of the other is statics as well."""
    robot = biped14.robot
    at = place_links(robot.tree, table.q)
    rng = np.random.default_rng(2)
    pressed = {}
    extra = rng.normal(0, 20, (len(table), 6)) * np.array([[s == "double"] for s in table.support])
    for sensor, sign in (("l_foot", 1.0), ("r_foot", -1.0)):
        R, p = at.joint(robot.sensors[sensor].joint)
        force, moment = extra[:, :3], extra[:, 3:] - np.cross(p, extra[:, :3])
        turned = [np.einsum("nji,nj->ni", R, v) for v in (force, moment)]
        pressed[sensor] = table.wrench[sensor] + sign * np.concatenate(turned, axis=1)
    kinds = largest(parity(Assumed(robot), replace(table, wrench=pressed)))
    assert max(kinds[k] for k in ("equilibrium", "closure", "imu", "sensor")) < 1e-10
    assert kinds["torque"] > 1.0


def test_a_sloping_floor_is_seen_by_forces_and_imu_and_not_by_closure(biped14):
    plan = [replace(p, floor_pitch=0.03, floor_roll=-0.02) for p in biped14.plan[15:25]]
    sloped = biped14.measure([p for p in plan if p.support == "double"])
    kinds = largest(parity(Assumed(biped14.robot), sloped))
    assert kinds["equilibrium"] > 5.0
    assert kinds["imu"] == pytest.approx(0.03, rel=0.2)
    assert kinds["closure"] < 1e-12
    known = Assumed(biped14.robot, floor=np.array([-0.02, 0.03]))
    assert max(largest(parity(known, sloped)).values()) < 1e-10


def test_a_load_that_is_assumed_takes_its_force_out_of_every_row(biped14):
    """30 N pulling the torso: as if 30 N / g of mass hung there, which the world can do."""
    robot = biped14.robot
    k, hung = robot.tree.link_index["torso"], 3.0
    point = np.array([0.1, 0.02, 0.3])
    link = robot.tree.links[k]
    mass = link.mass + hung
    heavier = replace(link, mass=mass, com=(link.mass * link.com + hung * point) / mass)
    links = tuple(heavier if i == k else old for i, old in enumerate(robot.tree.links))
    true = replace(robot, tree=replace(robot.tree, links=links))
    standing = [p for p in biped14.plan if p.support != "none"]
    table = biped14.measure(standing, true_robot=true)
    without = largest(parity(Assumed(robot), table))
    assert without["equilibrium"] > 25.0
    assert without["torque"] > 1.0
    pull = Load(link=k, force=np.array([0.0, 0.0, -hung * robot.gravity]), point=point)
    assert max(largest(parity(Assumed(robot, loads=(pull,)), table)).values()) < 1e-9


def test_a_load_in_some_poses_only_leaves_the_others_alone(biped14, table):
    pull = Load(0, np.array([5.0, 0.0, 0.0]), poses=frozenset(table.pose[:2]))
    found = parity(Assumed(biped14.robot, loads=(pull,)), table)
    touched = {int(i) for i in found.pose[np.abs(found.values) > 1e-9]}
    assert touched == {0, 1}


def test_missing_readings_leave_gaps_and_nothing_else(biped14, table):
    wrench = {s: w.copy() for s, w in table.wrench.items()}
    left = next(i for i, s in enumerate(table.support) if s == "left")
    wrench["l_foot"][left] = np.nan
    torque = table.torque.copy()
    torque[left] = np.nan
    found = parity(Assumed(biped14.robot), replace(table, wrench=wrench, torque=torque))
    missing = {found.row[i].kind for i in np.flatnonzero(np.isnan(found.values))}
    assert missing == {"equilibrium", "torque"}
    assert {int(i) for i in found.pose[np.isnan(found.values)]} == {left}


def test_a_hanging_pose_without_its_imu_is_not_taken_for_an_upright_one(biped14, table):
    hanging = np.flatnonzero([s == "none" for s in table.support])
    imu = table.imu.copy()
    imu[hanging[0]] = np.nan
    whole = parity(Assumed(biped14.robot), table)
    found = parity(Assumed(biped14.robot), replace(table, imu=imu))
    assert {int(i) for i in found.pose[np.isnan(found.values)]} == {hanging[0]}
    there = np.isfinite(found.values)
    np.testing.assert_array_equal(found.values[there], whole.values[there])
    known = replace(table, imu=imu, base_tilt=np.zeros((len(table), 2)))
    assert np.isfinite(parity(Assumed(biped14.robot), known).values).all()


def test_the_term_of_the_paper_is_the_sum_of_all_joint_torques_about_y(biped14, table):
    published = parity(Assumed(biped14.robot, internal_torque=-1.0), table)
    sums = np.nansum(table.torque, axis=1)
    for value, i, row in zip(published.values, published.pose, published.row, strict=True):
        expected = -sums[i] if row.name == "equilibrium My" else 0.0
        assert value == pytest.approx(expected, abs=1e-9)
