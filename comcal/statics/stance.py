# SPDX-License-Identifier: Apache-2.0
"""The stance frame P: attached to the soles, not to gravity (method, section 1).

Each foot has sole axes: x to the toes, y left, z the sole normal away from the ground. Double
support: origin midway between the sensor origins as the kinematics place them, z the normalised
mean of the sole normals, y from the right to the left origin made orthogonal to z, x = y cross z.
One foot: that sensor's origin with its sole axes. Hanging: no P.
"""

from __future__ import annotations

import numpy as np

from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.support import standing_feet


def sensor_origin(robot: Robot, foot: str, placements: Placements) -> Array:
    """Return where a foot's load is measured, in the root frame, shape (N, 3) [m].

    The origin of the foot's sensor; without a sensor of its own, that of its sole frame.
    """
    sensor = robot.feet[foot].sensor
    if sensor is not None:
        return placements.joint(robot.sensors[sensor].joint)[1]
    return _sole(robot, foot, placements)[1]


def stance_frame(robot: Robot, support: str, placements: Placements) -> tuple[Array, Array]:
    """Return the stance frame P in the root frame for N poses of one support.

    Returns
    -------
    R_root_P : array, shape (N, 3, 3)
    p_root_P : array, shape (N, 3)
        [m]

    Raises
    ------
    ConfigError
        If the support is not one of this robot's.
    """
    feet = standing_feet(robot, support)
    soles = [_sole(robot, f, placements)[0] for f in feet]
    origins = [sensor_origin(robot, f, placements) for f in feet]
    if len(feet) == 1:
        return soles[0], origins[0]
    z = _unit(np.sum([R[..., 2] for R in soles], axis=0))
    across = origins[0] - origins[-1]
    y = _unit(across - np.sum(across * z, axis=-1, keepdims=True) * z)
    return np.stack([np.cross(y, z), y, z], axis=-1), np.mean(origins, axis=0)


def in_stance(R_root_P: Array, p_root_P: Array, placements: Placements) -> Placements:
    """Return *placements* seen from P instead of from the root link."""
    R_P_root = np.swapaxes(R_root_P, -1, -2)[:, None]
    return Placements(
        placements.tree,
        R_P_root @ placements.R,
        apply(R_P_root, placements.p - p_root_P[:, None]),
    )


def _sole(robot: Robot, foot: str, placements: Placements) -> tuple[Array, Array]:
    """Return the sole frame of a foot in the root frame: axes (N, 3, 3), origin (N, 3) [m]."""
    R, p = placements.link(robot.feet[foot].link)
    T = robot.feet[foot].T_link_sole
    return R @ T[:3, :3], p + apply(R, T[:3, 3])


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
