# SPDX-License-Identifier: Apache-2.0
"""What every world promises: the built-in statics and both engines pass the same tests.

Oracle of the engines is the built-in world, which has tests of its own. Not covered here: how
exact each engine is beyond these tolerances (its own test file), and the share of each of two
feet, which is statically indeterminate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from comcal.errors import UsageError
from comcal.measure.plan import DOUBLE, NONE, PlannedPose
from comcal.robot.frames import rotation_from_rpy, transform_from
from comcal.robot.kinematics import place_links
from comcal.robot.model import Foot, Robot, Sensor
from comcal.robot.tree import Array, Joint, JointType, Link, Mimic, Tree
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.world import World, WorldState


@dataclass(frozen=True)
class Contender:
    """A world under test and how well it has to do."""

    open: Callable[[Robot], World]
    length: float
    """[m], and N m per N of weight."""
    force: float
    """Relative to the weight."""
    slides: bool = True
    """Whether it takes robots with sliding joints."""


@pytest.fixture(
    params=[
        "builtin",
        pytest.param("pybullet", marks=pytest.mark.engine),
        pytest.param("mujoco", marks=pytest.mark.engine),
    ]
)
def contender(request: pytest.FixtureRequest) -> Iterator[Contender]:
    with ExitStack() as stack:

        def opened(kind: Callable[[Robot], World]) -> Callable[[Robot], World]:
            return lambda robot: stack.enter_context(closing(kind(robot)))

        if request.param == "builtin":
            yield Contender(opened(BuiltinWorld), 1e-9, 1e-9)
        elif request.param == "pybullet":
            pytest.importorskip("pybullet")
            from comcal_sims.pybullet_world import PybulletWorld

            yield Contender(opened(PybulletWorld), 2e-5, 2e-6, slides=False)
        else:
            pytest.importorskip("mujoco")
            from comcal_sims.mujoco_world import MujocoWorld

            # soles sink and tilt by some 1e-4 m and rad on MuJoCo's springy contacts
            yield Contender(opened(MujocoWorld), 3e-4, 5e-4)


def some(plan: tuple[PlannedPose, ...], support: str | None = None) -> list[PlannedPose]:
    """About four poses of a plan, of one kind of support if named."""
    poses = [p for p in plan if support in (None, p.support)]
    return poses[:: max(1, len(poses) // 4)]


def placed(world: World, pose: PlannedPose) -> WorldState:
    world.place(pose)
    return world.state()


def total_on_ground_part(robot: Robot, pose: PlannedPose, state: WorldState) -> Array:
    """Sum of the standing feet's wrenches in the world, about the world's origin."""
    placements = place_links(robot.tree, state.q)
    R0, p0 = state.T_world_base[:3, :3], state.T_world_base[:3, 3]
    total = np.zeros(6)
    for foot in robot.feet.values():
        if pose.support in (DOUBLE, foot.name):
            R, p = placements.joint(robot.sensors[foot.sensor].joint)
            force, moment = state.wrenches[foot.sensor].reshape(2, 3) @ (R0 @ R[0]).T
            total += np.concatenate([force, moment + np.cross(R0 @ p[0] + p0, force)])
    return total


def test_loaded_sensors_carry_the_weight_above_them(contender: Contender, generated: Any) -> None:
    robot = generated.robot
    world, oracle = contender.open(robot), BuiltinWorld(robot)
    for planned in (p for p in some(generated.plan) if p.support != NONE):
        for pose in (planned, replace(planned, floor_roll=0.03, floor_pitch=-0.02)):
            state, truth = placed(world, pose), placed(oracle, pose)
            total = total_on_ground_part(robot, pose, state)
            expected = total_on_ground_part(robot, pose, truth)
            weight = robot.tree.total_mass * robot.gravity
            np.testing.assert_allclose(total[:3], expected[:3], atol=contender.force * weight)
            np.testing.assert_allclose(total[3:], expected[3:], atol=contender.length * weight)


def test_com_base_and_joints_are_where_the_pose_puts_them(
    contender: Contender, generated: Any
) -> None:
    world, oracle = contender.open(generated.robot), BuiltinWorld(generated.robot)
    for pose in some(generated.plan):
        state, truth = placed(world, pose), placed(oracle, pose)
        np.testing.assert_allclose(state.com, truth.com, atol=contender.length)
        np.testing.assert_allclose(state.T_world_base, truth.T_world_base, atol=contender.length)
        np.testing.assert_allclose(state.q, pose.q, atol=1e-4)


@pytest.mark.parametrize("support", ["left", "right", NONE])
def test_open_chains_have_the_torques_and_wrenches_of_statics(
    contender: Contender, biped14: Any, support: str
) -> None:
    world, oracle = contender.open(biped14.robot), BuiltinWorld(biped14.robot)
    weight = biped14.robot.tree.total_mass * biped14.robot.gravity
    poses = some(biped14.plan, support)
    assert poses
    for pose in poses:
        state, truth = placed(world, pose), placed(oracle, pose)
        np.testing.assert_allclose(
            state.torques, truth.torques, atol=2.0 * contender.length * weight
        )
        for sensor, wrench in truth.wrenches.items():
            atol = max(contender.length, contender.force) * weight
            np.testing.assert_allclose(state.wrenches[sensor], wrench, atol=atol)


def test_torques_of_both_legs_add_up_to_those_of_statics(contender: Contender, table1: Any) -> None:
    world, oracle = contender.open(table1.robot), BuiltinWorld(table1.robot)
    weight = table1.robot.tree.total_mass * table1.robot.gravity
    legs = table1.robot.tree.joint_names
    left, right = ([i for i, n in enumerate(legs) if n.startswith(s)] for s in ("l_", "r_"))
    symmetric = tuple(p for p in table1.plan if np.array_equal(p.q[left], p.q[right]))
    for pose in some(symmetric):
        got, wanted = placed(world, pose).torques, placed(oracle, pose).torques
        np.testing.assert_allclose(
            got[left] + got[right], wanted[left] + wanted[right], atol=contender.length * weight
        )


def test_slope_turns_gravity_in_the_sole_as_the_method_says(
    contender: Contender, table1: Any
) -> None:
    """beta = -tan(pitch) / cos(roll), delta = tan(roll) (method, section 1)."""
    roll, pitch = np.deg2rad(2.0), np.deg2rad(5.0)
    middle = min(table1.plan, key=lambda p: float(np.linalg.norm(table1.com(p)[:2])))
    world = contender.open(table1.robot)
    state = placed(world, replace(middle, floor_roll=roll, floor_pitch=pitch))
    force = sum(wrench[:3] for wrench in state.wrenches.values())  # sensor axes = sole axes
    assert force[0] / force[2] == pytest.approx(-np.tan(pitch) / np.cos(roll), abs=contender.force)
    assert force[1] / force[2] == pytest.approx(np.tan(roll), abs=contender.force)


def test_imu_feels_gravity_upwards(contender: Contender, biped14: Any) -> None:
    world, oracle = contender.open(biped14.robot), BuiltinWorld(biped14.robot)
    pose = next(p for p in biped14.plan if p.support == "left")
    state, truth = placed(world, pose), placed(oracle, pose)
    assert truth.imu[2] > 8.0
    np.testing.assert_allclose(state.imu, truth.imu, atol=2e-3)


def test_time_passes_as_asked_and_a_standing_robot_stands(
    contender: Contender, table1: Any
) -> None:
    world = contender.open(table1.robot)
    before = placed(world, table1.plan[0])
    for _ in range(50):
        world.advance(0.0017)
    after = world.state()
    assert after.t - before.t == pytest.approx(0.085)
    np.testing.assert_allclose(after.com, before.com, atol=1e-6)


def test_same_pose_gives_the_same_state_to_the_last_bit(contender: Contender, biped14: Any) -> None:
    world = contender.open(biped14.robot)
    pose, other = biped14.plan[1], replace(biped14.plan[2], floor_roll=0.02)
    first = placed(world, pose)
    hanging = replace(biped14.plan[0], support=NONE)
    placed(world, other)
    placed(world, hanging)
    again = placed(world, pose)
    for name in ("q", "torques", "com", "T_world_base"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    for sensor, wrench in first.wrenches.items():
        np.testing.assert_array_equal(wrench, again.wrenches[sensor])


def test_state_before_the_first_pose_is_refused(contender: Contender, table1: Any) -> None:
    world = contender.open(table1.robot)
    with pytest.raises(UsageError, match="place"):
        world.state()
    with pytest.raises(UsageError, match="place"):
        world.advance(0.1)


def test_closed_world_is_refused(contender: Contender, table1: Any) -> None:
    world = contender.open(table1.robot)
    world.place(table1.plan[0])
    world.close()
    world.close()
    with pytest.raises(UsageError):
        world.state()


def odd_robot(lift: JointType) -> Robot:
    """A tree rooted at its only foot, with all that engines tend to trip over.

    An oblique fixed joint, off-diagonal inertias, a slider or hinge, a massless yoke, a mimic, a
    massless tip, a motorised joint with a sensor, and a sensor whose cut has the root below it.
    """
    inertia = np.array([[0.03, 0.004, -0.002], [0.004, 0.02, 0.003], [-0.002, 0.003, 0.04]])

    def link(name: str, mass: float, *com: float) -> Link:
        return Link(name, mass, np.array(com), mass * inertia, has_inertial=mass > 0.0)

    def joint(
        name: str,
        kind: JointType,
        parent: str,
        child: str,
        origin: tuple[float, float, float],
        axis: tuple[float, float, float] = (0.0, 0.0, 0.0),
        rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
        mimic: Mimic | None = None,
    ) -> Joint:
        T = transform_from(rotation_from_rpy(rpy), origin)
        return Joint(name, kind, parent, child, T, np.array(axis), mimic=mimic)

    revolute, y = JointType.REVOLUTE, (0.0, 1.0, 0.0)
    joints = (
        joint("cut", JointType.FIXED, "plate", "foot", (0.02, 0.01, 0.05), rpy=(0.1, -0.2, 0.3)),
        joint("lift", lift, "foot", "column", (0.0, 0.0, 0.1), (0.0, 0.6, 0.8)),
        joint("lean", revolute, "column", "yoke", (0.0, 0.0, 0.2), y, rpy=(-0.2, 0.1, 0.0)),
        joint("nod", JointType.CONTINUOUS, "yoke", "body", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        joint("wag", revolute, "body", "tail", (-0.1, 0.0, 0.1), y, mimic=Mimic("nod", -0.5, 0.1)),
        joint("end", JointType.FIXED, "tail", "tip", (-0.2, 0.0, 0.0)),
    )
    links = (
        link("plate", 0.8, 0.02, -0.03, 0.02),
        link("foot", 1.5, 0.01, 0.02, 0.03),
        link("column", 2.0, 0.0, 0.01, 0.1),
        link("yoke", 0.0, 0.0, 0.0, 0.0),
        link("body", 4.0, 0.03, -0.02, 0.05),
        link("tail", 0.5, -0.1, 0.01, 0.0),
        link("tip", 0.0, 0.0, 0.0, 0.0),
    )
    T_link_sole = transform_from(rotation_from_rpy((0.0, 0.1, 0.4)), (0.01, 0.0, -0.01))
    sole = np.array([[0.3, 0.2], [-0.25, 0.25], [-0.2, -0.3], [0.25, -0.2]])
    return Robot(
        "odd",
        Tree("odd", links, joints),
        gravity=9.7,
        sensors={"ankle": Sensor("ankle", "cut"), "neck": Sensor("neck", "nod")},
        feet={"left": Foot("left", "plate", "ankle", sole, T_link_sole, None)},
        imu_link="tail",
    )


@pytest.mark.parametrize("support", ["left", DOUBLE, NONE])
@pytest.mark.parametrize("lift", [JointType.REVOLUTE, JointType.PRISMATIC])
def test_odd_trees_are_no_exception(contender: Contender, lift: JointType, support: str) -> None:
    robot = odd_robot(lift)
    if lift is JointType.PRISMATIC and not contender.slides:
        with pytest.raises(UsageError, match="sliding"):
            contender.open(robot)
        return
    floor = {} if support == NONE else {"floor_roll": 0.05, "floor_pitch": 0.08}
    pose = PlannedPose(1, np.array([0.03, 0.2, -0.4]), support, **floor)
    state, truth = placed(contender.open(robot), pose), placed(BuiltinWorld(robot), pose)
    weight = robot.tree.total_mass * robot.gravity
    for name in ("q", "T_world_base", "com"):
        np.testing.assert_allclose(getattr(state, name), getattr(truth, name), atol=2e-4)
    np.testing.assert_allclose(state.imu, truth.imu, atol=2e-3)
    for name, wrench in truth.wrenches.items():
        np.testing.assert_allclose(state.wrenches[name], wrench, atol=contender.force * weight)
    np.testing.assert_allclose(state.torques, truth.torques, atol=contender.force * weight)
    # gravity pulls at both sensors, but only one of them has the ground on the child side
    assert truth.wrenches["neck"][2] * truth.wrenches["ankle"][2] < 0.0
