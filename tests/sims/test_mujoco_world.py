# SPDX-License-Identifier: Apache-2.0
"""How exact MuJoCo is on springy contacts, and that its servos end where they were told to.

The oracle is the engine itself: the wrenches of its sensors against the CoMs of its own bodies.
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

pytest.importorskip("mujoco")

from comcal_sims.mujoco_world import MujocoWorld

pytestmark = pytest.mark.engine


def line_misses_com_by(robot: Robot, pose: PlannedPose, state: WorldState) -> Array:
    """Distance of the carried CoM from the line of action in the world, x and y [m]."""
    placements = place_links(robot.tree, state.q)
    R0, p0 = state.T_world_base[:3, :3], state.T_world_base[:3, 3]
    total, below = np.zeros(6), np.zeros(len(robot.tree.links), dtype=bool)
    for foot in robot.feet.values():
        if pose.support in (DOUBLE, foot.name):
            R, p = placements.joint(robot.sensors[foot.sensor].joint)
            force, moment = state.wrenches[foot.sensor].reshape(2, 3) @ (R0 @ R[0]).T
            total += np.concatenate([force, moment + np.cross(R0 @ p[0] + p0, force)])
            below |= robot.below_cut[foot.sensor]
    masses, coms = robot.tree.masses, placements.coms[0] @ R0.T + p0
    com = (masses.sum() * state.com - masses[below] @ coms[below]) / masses[~below].sum()
    moment = total[3:] - np.cross(com, total[:3])
    return np.array([-moment[1], moment[0]]) / total[2]


def test_carried_com_lies_on_the_line_of_action(generated: Any) -> None:
    poses = [p for p in generated.plan if p.support != NONE][::5]
    with MujocoWorld(generated.robot) as world:
        for pose in poses:
            for floor in ({}, {"floor_roll": 0.02, "floor_pitch": -0.03}):
                sloping = replace(pose, **floor)
                world.place(sloping)
                miss = line_misses_com_by(generated.robot, sloping, world.state())
                np.testing.assert_allclose(miss, 0.0, atol=5e-5)  # usually 1e-9


def test_engine_has_the_mass_distribution_of_the_urdf(generated: Any) -> None:
    robot = generated.robot
    with MujocoWorld(robot) as world:
        for pose in generated.plan[::9]:
            world.place(pose)
            state = world.state()
            expected = place_links(robot.tree, state.q).total_com()[0]
            T = state.T_world_base
            np.testing.assert_allclose(state.com, T[:3, :3] @ expected + T[:3, 3], atol=1e-9)


def test_servos_end_where_they_were_told_to(generated: Any) -> None:
    with MujocoWorld(generated.robot) as world:
        for pose in generated.plan[::9]:
            world.place(pose)
            np.testing.assert_allclose(world.state().q, pose.q, atol=np.deg2rad(0.005))


def test_robot_that_falls_over_is_refused(biped14: Any) -> None:
    with (
        MujocoWorld(biped14.robot) as world,
        pytest.raises(NotBalancedError, match="fell over"),
    ):
        world.place(replace(biped14.plan[0], floor_pitch=0.6))


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
        with MujocoWorld(replace(robot, tree=replace(tree, joints=joints))) as world:
            world.place(hanging)
            sag.append(float(np.abs(world.state().q - q).max()))
    assert sag[0] < 1e-4
    assert sag[1] > 0.1
