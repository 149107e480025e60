# SPDX-License-Identifier: Apache-2.0
"""Where the base of a robot has to be for its standing soles to rest flat on a sloping floor.

The world's z points up against gravity. The floor passes through the world's origin, and the stance
frame P (method, section 1) has the axes ``R_world_P = Ry(pitch) Rx(roll)`` with its origin straight
above that of the world, as seen along the floor's normal.
"""

from __future__ import annotations

import numpy as np

from comcal.errors import UsageError
from comcal.measure.plan import DOUBLE, NONE, PlannedPose
from comcal.robot.frames import transform_from
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Foot, Robot
from comcal.robot.tree import Array
from comcal_sims.rotations import floor_rotation

BUMPER_RADIUS = 0.010
"""Of the ball under each corner of a sole [m]."""

MAX_SOLE_TILT = np.deg2rad(3.0)
"""Largest angle between a standing sole and the floor [rad]."""
MAX_SOLE_GAP = 0.010
"""Largest distance of a standing sole from the floor [m]."""
MIN_CLEARANCE = 0.001
"""Least distance of a foot in the air from the floor [m]."""

HANGING_HEIGHT = 2.0
"""Height of the base link of a hanging robot [m]; there is no floor then."""


def standing_feet(robot: Robot, support: str) -> tuple[Foot, ...]:
    """Return the feet that stand in *support*; none when the robot hangs.

    Raises
    ------
    UsageError
        If *support* is neither ``double``, ``none`` nor a foot, or a standing sole is unknown.
    """
    if support == NONE:
        return ()
    names = tuple(robot.feet) if support == DOUBLE else (support,)
    unknown = [name for name in names if name not in robot.feet]
    if unknown or not names:
        raise UsageError(
            f"the robot cannot stand on {support!r}",
            where=robot.name,
            next_step=f"supports of this robot: {', '.join((DOUBLE, NONE, *robot.feet))}",
        )
    feet = tuple(robot.feet[name] for name in names)
    for foot in feet:
        if foot.sole is None:
            raise UsageError(
                f"foot {foot.name!r} has no sole to stand on",
                where=robot.name,
                next_step=f"give feet.{foot.name}.sole in robot.yaml",
            )
    return feet


def bumper_centres(foot: Foot) -> Array:
    """Return the centres of the balls under a sole, in the foot's link frame, shape (n, 3) [m].

    The lowest point of each ball is a corner of the sole, so that the contact points, unlike those
    of a flat box on a plane, never change from one step to the next. Empty without a sole.
    """
    corners = np.zeros((0, 2)) if foot.sole is None else foot.sole
    in_sole = np.column_stack([corners, np.full(len(corners), BUMPER_RADIUS)])
    return in_sole @ foot.T_link_sole[:3, :3].T + foot.T_link_sole[:3, 3]


def base_in_world(robot: Robot, pose: PlannedPose) -> Array:
    """Return the pose of the root link that puts *pose* on its floor, shape (4, 4).

    A robot that hangs is level, ``HANGING_HEIGHT`` above the origin.

    Raises
    ------
    UsageError
        If the robot has no such support, the standing soles do not lie in one plane, or a foot that
        should be in the air reaches the floor.
    """
    feet = standing_feet(robot, pose.support)
    if not feet:
        return transform_from(np.eye(3), (0.0, 0.0, HANGING_HEIGHT))
    placements = place_links(robot.tree, pose.q)
    T_base_soles = [_link(placements, foot.link) @ foot.T_link_sole for foot in feet]
    R_base_P, origin = _stance_frame(robot, feet, T_base_soles, placements)
    heights = [float(R_base_P[:, 2] @ (T[:3, 3] - origin)) for T in T_base_soles]
    floor = float(np.mean(heights))
    _check_flat(pose, feet, R_base_P, T_base_soles, [h - floor for h in heights])
    T_base_floor = transform_from(R_base_P, origin + floor * R_base_P[:, 2])
    _check_clearance(robot, pose, T_base_floor, placements)
    R_world_P = floor_rotation(pose.floor_roll, pose.floor_pitch)
    return transform_from(R_world_P, np.zeros(3)) @ np.linalg.inv(T_base_floor)


def _stance_frame(
    robot: Robot, feet: tuple[Foot, ...], T_base_soles: list[Array], placements: Placements
) -> tuple[Array, Array]:
    """Return axes and origin of P in the base frame, by the definition in method, section 1."""
    origins = [
        T[:3, 3]
        if foot.sensor is None
        else placements.joint(robot.sensors[foot.sensor].joint)[1][0]
        for foot, T in zip(feet, T_base_soles, strict=True)
    ]
    if len(feet) == 1:
        return T_base_soles[0][:3, :3], origins[0]
    z = _unit(np.sum([T[:3, 2] for T in T_base_soles], axis=0))
    across = origins[0] - origins[1]
    if across @ T_base_soles[0][:3, 1] < 0.0:  # the first foot of robot.yaml is the right one
        across = -across
    y = _unit(across - (across @ z) * z)
    return np.stack([np.cross(y, z), y, z], axis=-1), np.mean(origins, axis=0)


def _check_flat(
    pose: PlannedPose,
    feet: tuple[Foot, ...],
    R_base_P: Array,
    T_base_soles: list[Array],
    gaps: list[float],
) -> None:
    for foot, T, gap in zip(feet, T_base_soles, gaps, strict=True):
        tilt = float(np.arccos(np.clip(R_base_P[:, 2] @ T[:3, 2], -1.0, 1.0)))
        if tilt > MAX_SOLE_TILT or abs(gap) > MAX_SOLE_GAP:
            raise UsageError(
                f"the soles do not lie in one plane: the angles do not close foot {foot.name!r}",
                where=f"pose {pose.pose}",
                measured=f"tilt {np.degrees(tilt):.2f} deg, gap {gap * 1e3:.1f} mm",
                limit=f"{np.degrees(MAX_SOLE_TILT):.1f} deg, {MAX_SOLE_GAP * 1e3:.0f} mm",
                next_step="correct the angles of that leg or plan single support",
            )


def _check_clearance(
    robot: Robot, pose: PlannedPose, T_base_floor: Array, placements: Placements
) -> None:
    """Raise if a foot in the air is not."""
    for foot in robot.feet.values():
        if pose.support in (DOUBLE, foot.name) or foot.sole is None:
            continue
        T_floor_link = np.linalg.inv(T_base_floor) @ _link(placements, foot.link)
        centres = bumper_centres(foot) @ T_floor_link[:3, :3].T + T_floor_link[:3, 3]
        clearance = float(centres[:, 2].min()) - BUMPER_RADIUS
        if clearance < MIN_CLEARANCE:
            raise UsageError(
                f"foot {foot.name!r} reaches the floor although only {pose.support!r} stands",
                where=f"pose {pose.pose}",
                measured=f"clearance {clearance * 1e3:.1f} mm",
                limit=f"{MIN_CLEARANCE * 1e3:.0f} mm",
                next_step="bend its knee further or plan double support",
            )


def _link(placements: Placements, name: str) -> Array:
    R, p = placements.link(name)
    return transform_from(R[0], p[0])


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)
