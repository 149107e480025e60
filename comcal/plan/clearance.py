# SPDX-License-Identifier: Apache-2.0
"""How high everything that must not touch the floor is above it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.plan.motion import SoleMotion, sole_motion
from comcal.plan.solids import Solid
from comcal.plan.stand import Stand
from comcal.robot.tree import Array

CLEARANCE = 0.03
"""Least height of the soles in the air, of collision geometry, and of link origins and CoMs [m].
What is lower than twice this where the robot stands at q = 0 belongs to a foot."""


def heights(stand: Stand, at: SoleMotion, solids: Sequence[Solid] = ()) -> Array:
    """Return the height of the lowest watched point of N poses, shape (N,) [m].

    Parameters
    ----------
    stand : Stand
    at : SoleMotion
    """
    robot = stand.robot
    tree = robot.tree
    lowest = np.full(len(at.axis), np.inf)
    zero = sole_motion(robot, stand.feet[0], np.zeros((1, len(tree.joint_names))))
    high = [
        k
        for k, z in enumerate(_link_points(zero).min(axis=2)[0])
        if z > 2.0 * CLEARANCE and tree.links[k].mass > 0.0
    ]
    if high:
        lowest = _link_points(at)[:, high].min(axis=(1, 2))
    for solid in solids:
        if _solid_heights(zero, solid)[0] > 2.0 * CLEARANCE:
            lowest = np.minimum(lowest, _solid_heights(at, solid))
    for name, foot in robot.feet.items():
        if name in stand.feet or foot.sole is None:
            continue
        T = foot.T_link_sole
        corners = np.column_stack([foot.sole, np.zeros(len(foot.sole))]) @ T[:3, :3].T + T[:3, 3]
        sole = Solid(tree.link_index[foot.link], corners)
        lowest = np.minimum(lowest, _solid_heights(at, sole))
    return lowest


def _link_points(at: SoleMotion) -> Array:
    """Return the heights of origin and CoM of every link, shape (N, n_links, 2) [m]."""
    origins = at.points(at.placements.p)[..., 2]
    return np.stack([origins, at.points(at.placements.coms)[..., 2]], axis=2)


def _solid_heights(at: SoleMotion, solid: Solid) -> Array:
    """Return the height of the lowest point of a solid, shape (N,) [m]."""
    R_root_floor, origin = at.sole(at.foot)
    up = R_root_floor[:, :, 2]
    R, p = at.placements.R[:, solid.link], at.placements.p[:, solid.link]
    in_link = np.einsum("nij,ni->nj", R, up) @ solid.points.T
    return in_link.min(axis=1) + np.sum((p - origin) * up, axis=1)
