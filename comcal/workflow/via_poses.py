# SPDX-License-Identifier: Apache-2.0
"""Where a robot goes before a pose whose joints are to arrive from a certain side.

A via-pose lies a few degrees beyond its pose, against the side demanded. It has to be a place where
the robot can stand: within the joint limits, with all soles still on the floor where they are, and
balanced. What the closed chain of two feet forbids is taken back as little as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import ConfigError
from comcal.measure.both_sides import DEFAULT_VIA
from comcal.measure.plan import NONE, PlannedPose
from comcal.measure.sole_hull import distance_inside
from comcal.plan.motion import sole_motion
from comcal.plan.stand import Stand, stand_of
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array, JointType

SLIDE = 0.1
"""A sliding joint goes as far as a turning one moves a point at this distance [m]."""

LEAST_PART = 0.25
"""A joint with less of the way than this, for its limit or the floor, is not approached."""

BALANCE_MARGIN = 0.005
"""Of the CoM from the edge of the soles [m], or as much as the pose itself has."""

CLOSED = 1e-9
"""Turn [rad] and shift [m] of a sole below which the chain is closed."""

NEWTON_STEPS = 20


@dataclass(frozen=True)
class Vias:
    """Via-poses by pose id, and which joints cannot be approached as demanded.

    Parameters
    ----------
    poses : dict from int to PlannedPose
    without_room : dict from int to tuple of str
        Joints that a limit, the floor or the balance keeps on one side.
    """

    poses: dict[int, PlannedPose]
    without_room: dict[int, tuple[str, ...]]


def via_poses(robot: Robot, plan: Sequence[PlannedPose], distance: float = DEFAULT_VIA) -> Vias:
    """Return the via-poses of a plan.

    Parameters
    ----------
    robot : Robot
    plan : sequence of PlannedPose
        In the order of driving. A joint that comes from far enough on the right side anyway needs
        none.
    distance : float
        How far beyond [rad].
    """
    poses: dict[int, PlannedPose] = {}
    without_room: dict[int, tuple[str, ...]] = {}
    tree = robot.tree
    names = tree.joint_names
    slides = [tree.joints[tree.joint_index[n]].kind is JointType.PRISMATIC for n in names]
    ways = distance * np.where(slides, SLIDE, 1.0)
    before: PlannedPose | None = None
    for pose in plan:
        sides = np.array([float(np.sign(pose.approach.get(name, 0))) for name in names])
        if _needs_via(pose, before, sides, ways):
            q = _reachable(robot, pose, sides * ways)
            way = (pose.q - q) * sides
            lacks = (sides != 0.0) & (way < LEAST_PART * ways)
            if lacks.any():
                without_room[pose.pose] = tuple(n for n, x in zip(names, lacks, strict=True) if x)
            if not lacks[sides != 0.0].all():
                # A joint without room goes along, but is not asked to be beyond.
                q = np.where(lacks, pose.q, q) if _is_free(robot, pose) else q
                poses[pose.pose] = replace(pose, q=q)
        before = pose
    return Vias(poses, without_room)


def _needs_via(pose: PlannedPose, before: PlannedPose | None, sides: Array, ways: Array) -> bool:
    asked = sides != 0.0
    if not asked.any() or before is None:
        return bool(asked.any())
    return bool(((pose.q - before.q) * sides < ways)[asked].any())


def _is_free(robot: Robot, pose: PlannedPose) -> bool:
    """Whether no floor ties the joints to one another."""
    return (
        pose.support == NONE
        or robot.base is Base.FIXED
        or not robot.tree.geometry_known
        or len(robot.feet) == 0
    )


def _reachable(robot: Robot, pose: PlannedPose, back: Array) -> Array:
    """Return where to go: as far beyond as limits, soles and balance allow, shape (n_joints,)."""
    low, high = _limits(robot)
    if _is_free(robot, pose):
        return np.clip(pose.q - back, np.minimum(low, pose.q), np.maximum(high, pose.q))
    try:
        stand = stand_of(robot, pose.support, -np.inf)
    except ConfigError:  # no outline of the soles: nothing can be said about balance
        return np.clip(pose.q - back, np.minimum(low, pose.q), np.maximum(high, pose.q))
    stand = _as_in(stand, pose)
    part = 1.0
    while part >= LEAST_PART:
        q = np.clip(pose.q - part * back, low, high)
        q = np.clip(_closed(stand, q), low, high)
        if _stands(stand, q, pose):
            return q
        part /= 2.0
    return pose.q


def _limits(robot: Robot) -> tuple[Array, Array]:
    tree = robot.tree
    joints = [tree.joints[tree.joint_index[name]] for name in tree.joint_names]
    return np.array([j.lower for j in joints]), np.array([j.upper for j in joints])


def _as_in(stand: Stand, pose: PlannedPose) -> Stand:
    """Return the stand whose soles are where they are in *pose*."""
    at = sole_motion(stand.robot, stand.feet[0], pose.q[None])
    R, p = [np.eye(3)], [np.zeros(3)]
    for foot in stand.feet[1:]:
        R_is, p_is = at.relative_sole(foot)
        R.append(R_is[0])
        p.append(p_is[0])
    return replace(stand, R=np.array(R), p=np.array(p))


def _closed(stand: Stand, q: Array) -> Array:
    """Return the nearest joint positions that keep the soles in place."""
    if len(stand.feet) < 2:
        return q
    for _ in range(NEWTON_STEPS):
        at = sole_motion(stand.robot, stand.feet[0], q[None])
        error = stand.closure_error(at)[0]
        if np.abs(error).max() < CLOSED:
            break
        q = q - np.linalg.pinv(stand.closure_jacobian(at)[0]) @ error
    return q


def _stands(stand: Stand, q: Array, pose: PlannedPose) -> bool:
    at = sole_motion(stand.robot, stand.feet[0], np.array([q, pose.q]))
    if len(stand.feet) > 1 and np.abs(stand.closure_error(at)[0]).max() > 1e-4:
        return False
    margins = [distance_inside(com[:2], stand.corners()) for com in at.com()]
    return bool(margins[0] >= min(BALANCE_MARGIN, margins[1]))
