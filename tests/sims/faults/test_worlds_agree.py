# SPDX-License-Identifier: Apache-2.0
"""The same effect in plain statics, pybullet and MuJoCo does the same.

On one foot, or hanging, everything is determined; on two feet only the sums of both sensors are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from comcal.measure.source import Block, SourceRequest
from comcal.robot.changes_text import change_text
from comcal.robot.healthy import draw_healthy
from comcal.robot.kinematics import place_links
from comcal_sims import sources

pytestmark = pytest.mark.engine

EFFECTS = (
    "payload@l_arm:mass=2,com_z=-0.4",
    "joint_compliance@all:stiffness=3000",
    "backlash@l_knee:half_width=0.004",
    "joint_offset@l_hip_roll:offset=0.01",
    "ft_mounting@l_foot:ry=0.02",
    "ft_position@l_foot:x=0.01",
    "ground_tilt:pitch=0.01",
    "imu_mounting:pitch=0.01",
    "sole_compliance@all:tilt_x=2e-4,tilt_y=2e-4",
    "foot_placement@left:z=0.004,pitch=0.01",
    "cable_pull@torso:force_x=10,force_y=-5",
    "tether@pelvis:force_x=5,k_xx=80,k_yy=40",
    "external_contact@l_arm:force_z=10,point_z=-0.5",
    "link_length@l_knee:z=0.008",
    "joint_friction@all:coulomb=2,load_factor=0.05",
)
POSES = (20, 39)
"""On the left foot, and hanging."""


def measured(biped14: Any, engine: str, poses: tuple[int, ...], *effects: str) -> list[Block]:
    request = SourceRequest(biped14.robot, seed=1, noise=False, effects=effects, plan=biped14.plan)
    blocks = []
    with getattr(sources, f"open_{engine}")(request) as source:
        for pose in biped14.plan:
            if pose.pose in poses:
                source.move_to(pose)
                blocks.append(source.read(0.01))
    return blocks


# 64 kg weigh 630 N; MuJoCo's soles sink, and lean by some 1e-4 rad
LIMITS = {"pybullet": (2e-3, 2e-3, 1e-4, 2e-4), "mujoco": (0.2, 0.2, 2e-4, 3e-3)}


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
@pytest.mark.parametrize("effect", EFFECTS)
def test_effects_agree_with_plain_statics(biped14: Any, engine: str, effect: str) -> None:
    pytest.importorskip(engine)
    force, moment, angle, imu = LIMITS[engine]
    truth = measured(biped14, "builtin", POSES, effect)
    for true, found in zip(truth, measured(biped14, engine, POSES, effect), strict=True):
        for sensor, wrench in true.wrenches.items():
            off = np.abs(found.wrenches[sensor][-1] - wrench[-1])
            assert off[:3].max() < force
            assert off[3:].max() < moment
        np.testing.assert_allclose(found.q[-1], true.q[-1], atol=angle)
        np.testing.assert_allclose(found.imu[-1], true.imu[-1], atol=imu)
        np.testing.assert_allclose(found.currents[-1], true.currents[-1], atol=moment / 2)


@pytest.mark.parametrize("engine", ["builtin", "pybullet", "mujoco"])
def test_springs_close_the_chain_of_both_legs(biped14: Any, engine: str) -> None:
    """Hooke's law takes encoders and currents to joints, with which both soles lie flat.

    The share of each leg, hence every torque, is another one in each world.
    """
    if engine != "builtin":
        pytest.importorskip(engine)
    robot = biped14.robot
    (block,) = measured(biped14, engine, (3,), "joint_compliance@all:stiffness=3000")
    motors = [robot.motors[name] for name in robot.tree.joint_names]
    torques = block.currents[-1] * [m.torque_constant * m.gear * m.sign for m in motors]
    normals = []
    for q in (block.q[-1], block.q[-1] - torques / 3000):
        at = place_links(robot.tree, q)
        axes = [at.link(foot.link)[0][0] @ foot.T_link_sole[:3, 2] for foot in robot.feet.values()]
        normals.append(np.linalg.norm(axes[0] - axes[1]))
    limit = 5e-4 if engine == "mujoco" else 1e-5
    assert normals[0] > 10 * limit
    assert normals[1] < limit


@pytest.mark.parametrize("engine", ["builtin", "pybullet", "mujoco"])
def test_friction_is_that_of_the_torque_at_rest_on_any_feet(biped14: Any, engine: str) -> None:
    """From whatever sides the joints came, also such that no closed chain could move that way."""
    if engine != "builtin":
        pytest.importorskip(engine)
    robot, rng = biped14.robot, np.random.default_rng(4)
    names = robot.tree.joint_names
    chosen = [p for p in biped14.plan if p.pose in (2, 3, 4, 20, 21, 34, 39)]
    sides = rng.choice([-1, 1], (len(chosen), len(names)))
    plan = [
        replace(p, approach=dict(zip(names, side, strict=True)))
        for p, side in zip(chosen, sides.tolist(), strict=True)
    ]
    motors = [robot.motors[name] for name in names]
    constants = [m.torque_constant * m.gear * m.sign for m in motors]
    torques = []
    for effect in ((), ("joint_friction@all:coulomb=2,load_factor=0.1",)):
        request = SourceRequest(robot, seed=1, noise=False, effects=effect, plan=tuple(plan))
        with getattr(sources, f"open_{engine}")(request) as source:
            for pose in plan:
                source.move_to(pose)
                torques.append(source.read(0.1).currents[-1] * constants)
    free, stuck = np.reshape(torques, (2, len(plan), len(names)))
    limit = 0.02 if engine == "mujoco" else 1e-6  # its joints still creep a little
    np.testing.assert_allclose(stuck - free, (2.0 + 0.1 * np.abs(free)) * sides, atol=limit)


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_a_healthy_robot_stands_with_all_tolerances_at_once(biped14: Any, engine: str) -> None:
    """Two feet: the sums of both sensors agree, and encoders close as statics say they do."""
    pytest.importorskip(engine)
    rng = np.random.default_rng(3)
    effects = [change_text(change) for change in draw_healthy(biped14.robot, rng)]
    assert len({text.partition("@")[0] for text in effects}) > 15
    force, _, angle, imu = LIMITS[engine]
    truth = measured(biped14, "builtin", (3,), *effects)[0]
    found = measured(biped14, engine, (3,), *effects)[0]
    total = [sum(b.wrenches[s][-1, :3] for s in b.wrenches) for b in (truth, found)]
    np.testing.assert_allclose(total[0], total[1], atol=10 * force)
    np.testing.assert_allclose(found.q[-1], truth.q[-1], atol=4 * angle)
    np.testing.assert_allclose(found.imu[-1], truth.imu[-1], atol=4 * imu)


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_an_early_reading_sways_and_sways_less_later(biped14: Any, engine: str) -> None:
    pytest.importorskip(engine)
    pose = next(p for p in biped14.plan if p.pose == 20)
    request = SourceRequest(biped14.robot, 1, noise=False, effects=("not_settled:time=4",))
    with getattr(sources, f"open_{engine}")(request) as source:
        source.move_to(pose)
        block = source.read(3.4)
    ty = block.wrenches["l_foot"][:, 4]
    # one swing each; the first samples still feel the jerk with which the sway begins
    early, late = (np.ptp(ty[part]) for part in (slice(60, 160), slice(300, 400)))
    assert early > 1.0
    assert late / early == pytest.approx(np.exp(-2.0 / 1.5), rel=0.2)
