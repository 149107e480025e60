# SPDX-License-Identifier: Apache-2.0
"""comcal's conventions of joints and sensors, as every physics engine has to be told them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from comcal.errors import NotBalancedError
from comcal.measure.plan import PlannedPose
from comcal.robot.model import Robot
from comcal.robot.tree import Array, Tree

LARGEST_TURN = np.deg2rad(5.0)
"""Of the base against how it was put, beyond which the robot has fallen over [rad]."""
LARGEST_SHIFT = 0.05
"""Of the base against where it was put, beyond which the robot has slid away [m]."""


def link_name(k: int) -> str:
    """Return the name of link *k* of the tree inside an engine: numbered, so always legal."""
    return f"link{k}"


def joint_name(k: int) -> str:
    """Return the name of joint *k* of the tree inside an engine."""
    return f"joint{k}"


def joint_targets(tree: Tree, q: Array) -> dict[str, float]:
    """Return the wanted position of every movable joint, mimics included [rad] or [m].

    Parameters
    ----------
    tree : Tree
    q : array, shape (n_joints,)
        In the order of ``tree.joint_names``.
    """
    targets = dict(zip(tree.joint_names, q.tolist(), strict=True))
    for joint in tree.joints:
        if joint.is_movable and joint.mimic is not None:
            leader = targets[joint.mimic.joint]
            targets[joint.name] = joint.mimic.multiplier * leader + joint.mimic.offset
    return targets


def generalised_torques(tree: Tree, torques: Mapping[str, float]) -> Array:
    """Add the torques of mimics to those of the joints they follow, shape (n_joints,).

    Parameters
    ----------
    tree : Tree
    torques : mapping from joint name to float
        Of parent on child about +axis, for every movable joint [N m].
    """
    total = {name: torques[name] for name in tree.joint_names}
    for joint in tree.joints:
        if joint.is_movable and joint.mimic is not None:
            total[joint.mimic.joint] += joint.mimic.multiplier * torques[joint.name]
    return np.array(list(total.values()))


def on_part_above(robot: Robot, sensor: str, parent_on_child: Array) -> Array:
    """Turn an engine's joint wrench into that of the part below a cut on the part above it.

    Parameters
    ----------
    robot : Robot
    sensor : str
    parent_on_child : array, shape (6,)
        Across the sensor's joint [N, N m].
    """
    child = robot.tree.joint_index[robot.sensors[sensor].joint] + 1
    child_is_below = bool(robot.below_cut[sensor][child])
    return -parent_on_child if child_is_below else parent_on_child


def specific_force(robot: Robot, R_world_imu: npt.ArrayLike) -> Array:
    """Return what an accelerometer at rest reads in the axes of its link, shape (3,) [m/s^2]."""
    return robot.gravity * np.asarray(R_world_imu, dtype=np.float64)[2]


def check_standing(pose: PlannedPose, wanted: Array, found: Array) -> None:
    """Refuse a robot that did not stay where it was put.

    Parameters
    ----------
    pose : PlannedPose
    wanted, found : array, shape (4, 4)
        Pose of the root link in the world when placed, and after settling.

    Raises
    ------
    NotBalancedError
        If the base has turned or moved further than settling explains, or is nowhere.
    """
    turned = wanted[:3, :3].T @ found[:3, :3]
    turn = float(np.arccos(np.clip((np.trace(turned) - 1.0) / 2.0, -1.0, 1.0)))
    shift = float(np.linalg.norm(found[:3, 3] - wanted[:3, 3]))
    if not (turn <= LARGEST_TURN and shift <= LARGEST_SHIFT):  # NaN ends up here too
        raise NotBalancedError(
            "the robot fell over or slid away while settling",
            where=f"pose {pose.pose}",
            measured=f"base turned by {np.degrees(turn):.0f} deg, moved by {shift * 1e3:.0f} mm",
            limit=f"{np.degrees(LARGEST_TURN):.0f} deg, {LARGEST_SHIFT * 1e3:.0f} mm",
            next_step="move the CoM further inside the soles, or drop the pose",
        )
