# SPDX-License-Identifier: Apache-2.0
"""How exact pybullet is, and the traps of its interface that would be seen nowhere else.

The oracle is the engine itself: the wrenches of its sensors against the CoMs of its own links.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from comcal.errors import NotBalancedError
from comcal.measure.plan import DOUBLE, NONE, PlannedPose
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal_sims.world import WorldState

pytest.importorskip("pybullet")

from comcal_sims.pybullet_world import PybulletWorld

pytestmark = pytest.mark.engine


def standing(generated: Any, every: int) -> list[PlannedPose]:
    poses = [p for p in generated.plan if p.support != NONE]
    return poses[::every]


def horizontal_com(
    robot: Robot, pose: PlannedPose, state: WorldState
) -> tuple[Array, Array, float]:
    """X and Y of the carried mass: alpha, gamma by the wrenches, and by the engine [m]; Fz [N].

    On a level floor, about the midpoint of the loaded sensors.
    """
    placements = place_links(robot.tree, state.q)
    R0, p0 = state.T_world_base[:3, :3], state.T_world_base[:3, 3]
    origins, total, below = [], np.zeros(6), np.zeros(len(robot.tree.links), dtype=bool)
    for foot in robot.feet.values():
        if pose.support in (DOUBLE, foot.name):
            R, p = placements.joint(robot.sensors[foot.sensor].joint)
            force, moment = state.wrenches[foot.sensor].reshape(2, 3) @ (R0 @ R[0]).T
            origins.append(R0 @ p[0] + p0)
            total += np.concatenate([force, moment + np.cross(origins[-1], force)])
            below |= robot.below_cut[foot.sensor]
    middle = np.mean(origins, axis=0)
    moment = total[3:] - np.cross(middle, total[:3])
    by_wrench = np.array([-moment[1], moment[0]]) / total[2]
    masses, coms = robot.tree.masses, placements.coms[0] @ R0.T + p0
    carried = masses.sum() * state.com - masses[below] @ coms[below]
    return by_wrench, (carried / masses[~below].sum() - middle)[:2], float(total[2])


def test_carried_com_by_wrenches_is_that_of_the_engine(generated: Any) -> None:
    robot = generated.robot
    with PybulletWorld(robot) as world:
        for pose in standing(generated, every=5):
            world.place(pose)
            by_wrench, by_engine, fz = horizontal_com(robot, pose, world.state())
            np.testing.assert_allclose(by_wrench, by_engine, atol=5e-7)
            loaded = [f.sensor for f in robot.feet.values() if pose.support in (DOUBLE, f.name)]
            carried = ~np.any([robot.below_cut[s] for s in loaded], axis=0)
            weight = robot.tree.masses[carried].sum() * robot.gravity
            assert fz == pytest.approx(weight, abs=1e-4)


def test_engine_has_the_mass_distribution_of_the_urdf(generated: Any) -> None:
    """Phantom masses, ignored inertials or a base put by its inertial frame would show here."""
    robot = generated.robot
    with PybulletWorld(robot) as world:
        for pose in generated.plan[::9]:
            world.place(pose)
            state = world.state()
            expected = place_links(robot.tree, state.q).total_com()[0]
            T = state.T_world_base
            np.testing.assert_allclose(state.com, T[:3, :3] @ expected + T[:3, 3], atol=1e-7)


def test_feet_on_a_slope_do_not_creep(table1: Any) -> None:
    middle = min(table1.plan, key=lambda p: float(np.linalg.norm(table1.com(p)[:2])))
    with PybulletWorld(table1.robot) as world:
        world.place(replace(middle, floor_pitch=0.08))
        before = world.state()
        world.advance(1.0)
        assert np.linalg.norm(world.state().com - before.com) < 1e-6


def test_two_worlds_do_not_disturb_each_other(table1: Any, biped14: Any) -> None:
    with PybulletWorld(table1.robot) as alone:
        alone.place(table1.plan[1])
        alone.advance(0.1)
        expected = alone.state()
    with PybulletWorld(table1.robot) as first, PybulletWorld(biped14.robot) as second:
        first.place(table1.plan[1])
        second.place(biped14.plan[3])
        second.advance(0.1)
        first.advance(0.1)
        np.testing.assert_array_equal(first.state().q, expected.q)
        for sensor, wrench in expected.wrenches.items():
            np.testing.assert_array_equal(first.state().wrenches[sensor], wrench)


def test_compliant_soles_sink_and_tilt_by_weight_over_stiffness(table1: Any) -> None:
    """Each of the 8 pads has 350 weights per metre, whatever the robot weighs."""
    middle = min(table1.plan, key=lambda p: float(np.linalg.norm(table1.com(p)[:2])))
    heights = []
    for contact in ("rigid", "compliant"):
        with PybulletWorld(table1.robot, settle=1.5, contact=contact) as world:
            world.place(middle)
            heights.append(world.state().com[2])
            by_wrench, by_engine, _ = horizontal_com(table1.robot, middle, world.state())
            np.testing.assert_allclose(by_wrench, by_engine, atol=5e-7)
    x = table1.robot.feet["left"].sole[:, 0]
    ahead = table1.com(middle)[0] - x.mean()
    sink = (1.0 / 8 + ahead**2 / (2.0 * np.sum((x - x.mean()) ** 2))) / 350.0
    assert heights[0] - heights[1] == pytest.approx(sink, rel=0.02)


@pytest.mark.parametrize("pitch", [0.6, 1.0], ids=["tips over", "slides away"])
def test_robot_that_does_not_stay_is_refused(biped14: Any, pitch: float) -> None:
    with PybulletWorld(biped14.robot) as world, pytest.raises(NotBalancedError, match="fell over"):
        world.place(replace(biped14.plan[0], floor_pitch=pitch))


def test_joint_that_is_too_weak_gives_way(biped14: Any) -> None:
    """The URDF's effort is the motor's limit; without one, motors hold anything."""
    robot, tree = biped14.robot, biped14.robot.tree
    q = np.zeros(len(tree.joint_names))
    q[tree.joint_names.index("l_shoulder")] = 1.0
    hanging = PlannedPose(1, q, NONE)
    sag = []
    for effort in (np.inf, 0.5):
        joints = tuple(
            replace(j, effort=effort) if j.name == "l_shoulder" else j for j in tree.joints
        )
        with PybulletWorld(replace(robot, tree=replace(tree, joints=joints))) as world:
            world.place(hanging)
            sag.append(float(np.abs(world.state().q - q).max()))
    assert sag[0] < 1e-4
    assert sag[1] > 0.1
