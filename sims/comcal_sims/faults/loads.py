# SPDX-License-Identifier: Apache-2.0
"""Cables, tethers and hands: forces on links that the model does not know."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.measure.plan import NONE, PlannedPose
from comcal.robot.changes import Change
from comcal.robot.changes_table import STIFFNESS
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal_sims.rotations import floor_rotation
from comcal_sims.world import Load

_FORCE = ("force_x", "force_y", "force_z")
_POINT = ("point_x", "point_y", "point_z")


def loads_of(
    robot: Robot, changes: Sequence[Change], pose: PlannedPose, first: dict[str, Array]
) -> tuple[Load, ...]:
    """Return the forces that act in one pose.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
        Their forces and stiffness have the axes of P, hence of the floor. A robot that hangs is
        free of them all, but for a contact that is stated for that pose: in world axes.
    pose : PlannedPose
        On the true floor.
    first : dict from link name to array, shape (3,)
        Where the origin of each tethered link was in the first pose, in floor axes [m].
    """
    hangs = pose.support == NONE
    R = np.eye(3) if hangs else floor_rotation(pose.floor_roll, pose.floor_pitch)
    found = list[Load]()
    for change in changes:
        if change.effect not in ("cable_pull", "tether", "external_contact"):
            continue
        poses = change.poses()
        if poses is not None and pose.pose not in poses:
            continue
        if hangs and (poses is None or change.effect != "external_contact"):
            continue
        k = robot.tree.link_index[change.target]
        force = R @ np.array(change.numbers(*_FORCE))
        if change.effect == "tether":
            K = R @ stiffness_matrix(change) @ R.T
            found.append(Load(k, np.zeros(3), force, K, R @ first[change.target]))
        else:
            found.append(Load(k, np.array(change.numbers(*_POINT)), force))
    return tuple(found)


def stiffness_matrix(change: Change) -> Array:
    """Return the stiffness of a tether, shape (3, 3) [N/m]."""
    xx, yy, zz, xy, xz, yz = change.numbers(*STIFFNESS)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
