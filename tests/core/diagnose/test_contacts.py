# SPDX-License-Identifier: Apache-2.0
"""What a hand does in a single pose is a force at a place that it can reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comcal.diagnose.candidates import candidates
from comcal.diagnose.catalogue import catalogue
from comcal.diagnose.contacts import contacts, with_contact
from comcal.diagnose.evidence import explain
from comcal.diagnose.naming import Named, name_causes
from comcal.diagnose.scene import Scene, scene
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.model import Robot

HAND = np.array([0.0, 0.0, -0.6])
"""In the frame of an arm [m]."""


def looked_at(robot: Robot, table: PoseTable) -> Scene:
    return scene(catalogue(candidates(robot, table), robot), (Assumed(robot), table))


def names(named: Named) -> list[str]:
    return [named.scene.of.candidates[i].name for i in named.causes]


@pytest.fixture(scope="module")
def table(biped14) -> PoseTable:
    plan = [*biped14.plan[:32:4], *biped14.plan[36:]]
    return biped14.noisy(biped14.measure(plan), np.random.default_rng(12))


def test_of_a_robot_that_hangs_a_hand_is_a_force_within_reach(biped14, table: PoseTable) -> None:
    """Only the shoulder feels it, a couple about its axis: a hand makes one by a force."""
    robot, pose = biped14.robot, table.support.index("none")
    joint = robot.tree.joint_names.index("r_shoulder")
    torque = table.torque.copy()
    torque[pose, joint] += 9.0
    named = name_causes(looked_at(robot, replace(table, torque=torque)))
    assert names(named) == [f"external_contact@r_arm in pose {table.pose[pose]}"]
    candidate = named.scene.of.candidates[named.causes[0]]
    change = candidate.change(named.fit.coordinates)
    f, p = (
        np.array([change.number(f"{what}_{axis}") for axis in "xyz"]) for what in ("force", "point")
    )
    assert 5.0 < np.linalg.norm(f) < 60.0
    assert np.linalg.norm(p) < 1.0


def test_a_force_is_what_it_is_at_any_point_of_its_line(biped14, table: PoseTable) -> None:
    """Force and couple at the CoM give back the force, on a line through the hand."""
    about = looked_at(biped14.robot, table)
    tree, pose = biped14.robot.tree, table.support.index("double")
    link = tree.link_index["l_arm"]
    (touch,) = [c for c in contacts(about, ()) if (c.link, c.pose) == (link, pose)]
    there = with_contact(about, touch)
    candidate = there.of.candidates[-1]
    R_link_P, com = about.at.links.R_link_P[pose, link], tree.links[link].com
    force = np.array([12.0, -7.0, 15.0])
    couple = np.cross(R_link_P.T @ (HAND - com), force)
    change = candidate.change(np.array([*force, *couple]))
    f = np.array([change.number(f"force_{axis}") for axis in "xyz"])
    p = np.array([change.number(f"point_{axis}") for axis in "xyz"])
    np.testing.assert_allclose(f, force, atol=1e-12)
    np.testing.assert_allclose(np.cross(R_link_P.T @ (HAND - p), f), 0.0, atol=1e-9)


def test_a_touch_is_the_same_when_everything_is_linearised_anew(biped14, table: PoseTable) -> None:
    """A couple without a force is no contact: by steps of one its columns came out as zero."""
    about = looked_at(biped14.robot, table)
    pose, link = table.support.index("double"), biped14.robot.tree.link_index["l_arm"]
    (touch,) = [c for c in contacts(about, ()) if (c.link, c.pose) == (link, pose)]
    there = with_contact(about, touch)
    part = there.of.slices[-1]
    assert np.abs(there.raw[:, part]).max(axis=0).min() > 0.1
    np.testing.assert_array_equal(there.of.columns(there.at)[:, part], there.raw[:, part])


def test_a_touch_is_as_likely_written_out_as_among_all_others(biped14, table: PoseTable) -> None:
    """That it was in this pose is one of as many possibilities as there are poses."""
    w = {sensor: wrench.copy() for sensor, wrench in table.wrench.items()}
    pose = table.support.index("double")
    for sensor in w:
        w[sensor][pose, 2] -= 4.0
    about = looked_at(biped14.robot, replace(table, wrench=w))
    best = contacts(about, ())[0]
    there = with_contact(about, best)
    last = len(there.of.candidates) - 1
    alone = explain(there.of, last, there.against())
    assert alone.log_odds == pytest.approx(best.log_odds, rel=1e-6)
    assert there.of.log_prior[last] == pytest.approx(-np.log(len(table)))
    assert not there.of.log_prior[:last].any()
