# SPDX-License-Identifier: Apache-2.0
"""Every pose keeps every rule, by checks that share nothing with the planner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from comcal.errors import ConfigError, NotBalancedError
from comcal.plan.avoid import NEAR, Avoided, Region
from comcal.plan.candidates import Pool, neighbours, random_pool
from comcal.plan.loads import effort_shares
from comcal.plan.motion import sole_motion
from comcal.plan.rules import EFFORT_SHARE, rules_of
from comcal.plan.stand import stand_of
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot

MARGIN = 0.015
SUPPORTS = ("double", "left", "right")


def soles(robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """Sole frames in the root frame, shape (4, 4) each."""
    at = place_links(robot.tree, q)
    found = {}
    for name, foot in robot.feet.items():
        R, p = at.link(foot.link)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R[0], p[0]
        found[name] = T @ foot.T_link_sole
    return found


def distance_inside(robot: Robot, support: str, q: np.ndarray) -> float:
    """How far the CoM is inside the standing corners: over all directions in the floor plane."""
    frames = soles(robot, q)
    standing = [f for f in robot.feet if support in ("double", f)]
    T_floor_root = np.linalg.inv(frames[standing[0]])
    com = (T_floor_root @ [*place_links(robot.tree, q).total_com()[0], 1.0])[:2]
    corners = []
    for f in standing:
        flat = np.column_stack([robot.feet[f].sole, np.zeros(4), np.ones(4)])
        corners += [(T_floor_root @ frames[f] @ c)[:2] for c in flat]
    angle = np.linspace(0.0, 2.0 * np.pi, 2000)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    # Support function of the hull: no direction in which the CoM is nearer to its edge.
    return float((np.max(np.array(corners) @ direction.T, axis=0) - direction @ com).min())


def check(robot: Robot, poses: Pool) -> None:
    zero = soles(robot, np.zeros(poses.q.shape[1]))
    feet = list(robot.feet)
    relative = np.linalg.inv(zero[feet[0]]) @ zero[feet[1]]
    lower = [j.lower for j in robot.tree.joints if j.name in robot.tree.joint_names]
    upper = [j.upper for j in robot.tree.joints if j.name in robot.tree.joint_names]
    for support, q in zip(poses.support, poses.q, strict=True):
        assert np.all((q >= lower) & (q <= upper))
        assert distance_inside(robot, support, q) >= MARGIN - 1e-6
        frames = soles(robot, q)
        if support == "double":
            gap = np.linalg.inv(frames[feet[0]]) @ frames[feet[1]] - relative
            assert np.abs(gap).max() < 1e-4  # 0.1 mm, 0.1 mrad
        else:
            other = next(f for f in feet if f != support)
            flat = np.column_stack([robot.feet[other].sole, np.zeros(4), np.ones(4)])
            height = (np.linalg.inv(frames[support]) @ frames[other] @ flat.T)[2]
            assert height.min() > 0.02


def test_planned_and_random_poses_keep_every_rule(planning: Any) -> None:
    check(planning.robot, planning.found.poses)
    check(planning.robot, planning.random)


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_published_humanoids_find_poses_that_keep_every_rule(
    humanoid: Callable[[str], Robot], name: str
) -> None:
    robot = humanoid(name)
    rules = rules_of(robot, SUPPORTS, margin=MARGIN, share=0.9)
    rng = np.random.default_rng(3)
    pool = random_pool(rules, 2, rng)
    check(robot, pool)
    check(robot, neighbours(rules, pool, 5, 0.1, rng))


@pytest.mark.parametrize("support", SUPPORTS)
def test_efforts_are_those_of_the_equations_of_motion(
    humanoid: Callable[[str], Robot], support: str
) -> None:
    """Oracle: Pinocchio's gravity torques less J^T of a split found by its own search.

    The split itself is a choice; that the torques belong to one is checked by the residual.
    """
    pin = pytest.importorskip("pinocchio")
    robot = humanoid("talos")
    tree = robot.tree
    rules = rules_of(robot, (support,), margin=MARGIN, share=0.9)
    q = random_pool(rules, 1, np.random.default_rng(4)).q
    stand = rules.stands[support]
    at = sole_motion(robot, stand.feet[0], q)
    effort = np.array([tree.joints[tree.joint_index[n]].effort for n in tree.joint_names])
    torque = effort_shares(stand, at) * effort
    model = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    data = model.createData()
    model.gravity.linear[:] = [0.0, 0.0, -robot.gravity]
    for i in range(len(q)):
        R, p = (a[i] for a in at.sole(stand.feet[0]))
        full = pin.neutral(model)
        full[:3], full[3:7] = -R.T @ p, pin.Quaternion(R.T).coeffs()
        columns = [model.joints[model.getJointId(n)] for n in tree.joint_names]
        full[[c.idx_q for c in columns]] = q[i]
        gravity = pin.computeGeneralizedGravity(model, data, full)
        J = np.concatenate(
            [
                pin.computeFrameJacobian(
                    model, data, full, model.getFrameId(robot.feet[f].link), pin.LOCAL
                )
                for f in stand.feet
            ]
        )
        wanted = np.concatenate([np.zeros(6), torque[i]])
        rows = [*range(6), *(c.idx_v for c in columns)]
        # One wrench per foot must fit the six equations of the base and those of all joints.
        wrench, *_ = np.linalg.lstsq(J.T[rows], (gravity[rows] - wanted), rcond=None)
        np.testing.assert_allclose(J.T[rows] @ wrench, gravity[rows] - wanted, atol=1e-6)
    assert np.abs(torque / effort).max() <= EFFORT_SHARE


def test_weak_motor_is_spared(planning: Any) -> None:
    from dataclasses import replace

    robot = planning.robot
    joints = tuple(
        replace(j, effort=8.0) if j.name == "waist_pitch" else j for j in robot.tree.joints
    )
    weak = replace(robot, tree=replace(robot.tree, joints=joints))
    rules = rules_of(weak, ("left",), margin=MARGIN)
    pool = random_pool(rules, 10, np.random.default_rng(5))
    column = weak.tree.joint_names.index("waist_pitch")
    share = effort_shares(rules.stands["left"], sole_motion(weak, "left", pool.q))[:, column]
    assert np.abs(share).max() <= EFFORT_SHARE
    before = effort_shares(
        rules.stands["left"], sole_motion(weak, "left", planning.random.select(range(60, 120)).q)
    )
    assert np.abs(before[:, column]).max() > EFFORT_SHARE  # others would not have been


def test_avoided_postures_and_ranges_stay_away(planning: Any) -> None:
    robot, box = planning.robot, planning.rules.box
    column = robot.tree.joint_names.index("l_knee")
    region = Region((column,), (0.5,), (3.0,))
    first = random_pool(rules_of(robot, ("left",), margin=MARGIN), 5, np.random.default_rng(6)).q
    rules = rules_of(
        robot, ("left",), margin=MARGIN, avoided=Avoided(poses=tuple(first), regions=(region,))
    )
    q = random_pool(rules, 20, np.random.default_rng(6)).q
    assert not np.any((q[:, column] >= 0.5) & (q[:, column] <= 3.0))
    near = np.all(np.abs(q[:, None] - first) <= NEAR * box.range, axis=2)
    assert not near.any()


def test_margin_that_no_sole_has_room_for_is_refused(planning: Any) -> None:
    with pytest.raises(ConfigError, match="margin"):
        stand_of(planning.robot, "left", 0.2)


def test_robot_that_cannot_stand_says_which_rule_refused(planning: Any) -> None:
    everything = Region((0,), (-10.0,), (10.0,))
    rules = rules_of(
        planning.robot, ("left",), margin=MARGIN, avoided=Avoided(regions=(everything,))
    )
    with pytest.raises(NotBalancedError, match="to be avoided"):
        random_pool(rules, 1, np.random.default_rng(0), most_tries=4000)
