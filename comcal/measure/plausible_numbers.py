# SPDX-License-Identifier: Apache-2.0
"""Are joint positions, lengths and accelerations in SI, within limits, and at rest?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from comcal.errors import DataError, NotStillError, UnitsError
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array, Joint, JointType

LIMIT_MARGIN = {JointType.PRISMATIC: 0.05}
"""How far beyond its limits a joint may read [m]: zero offsets and soft stops."""
ANGLE_MARGIN = 0.35
"""The same for angles [rad]."""
DEGREES_EXCESS = 1.0
"""An angle further beyond its limit than this, that fits when divided by 57.3, is in degrees."""
FULL_TURN = 2.0 * np.pi
LARGEST_COM = 10.0
"""No CoM or CoP of a robot is further away [m]."""
LARGEST_VELOCITY = 0.05
"""A joint that moves faster is not still [rad/s or m/s]."""
LARGEST_DEVIATION = 0.02
"""A joint that wanders by more within its window is not still [rad or m]."""
LARGEST_FORCE_SLOPE = 0.05
"""Change of a force per second, as a part of the robot's weight."""
SLOPE_NOISE = 20.0
"""Slopes within this many stated standard errors per second may be noise of a light robot."""


def check_positions(table: PoseTable, robot: Robot) -> Iterator[DataError]:
    """Yield what is wrong with joint positions: degrees, millimetres, far beyond the limits.

    Parameters
    ----------
    table : PoseTable
    robot : Robot
    """
    joints = [robot.tree.joints[robot.tree.joint_index[n]] for n in robot.tree.joint_names]
    beyond: list[tuple[Joint, int, float]] = []
    scaled: list[tuple[Joint, int, float]] = []
    for k, joint in enumerate(joints):
        excess = _excess(joint, table.q[:, k])
        i = int(np.argmax(excess)) if excess.size else 0
        if not excess.size or excess[i] <= 0.0:
            continue
        is_angle = joint.kind is not JointType.PRISMATIC
        factor = np.pi / 180.0 if is_angle else 1e-3
        fits = bool((_excess(joint, table.q[:, k] * factor) <= 0.0).all())
        far = excess[i] > DEGREES_EXCESS if is_angle else True
        (scaled if fits and far else beyond).append((joint, i, float(table.q[i, k])))
    if scaled:
        joint, i, value = scaled[0]
        is_angle = joint.kind is not JointType.PRISMATIC
        also = f" (and {len(scaled) - 1} more joints)" if len(scaled) > 1 else ""
        yield UnitsError(
            f"q.{joint.name}{also} looks like {'degrees' if is_angle else 'millimetres'}",
            where=table.where(i),
            measured=f"{value:g}",
            limit=_range(joint),
            next_step=f"multiply the columns by {'pi/180' if is_angle else '0.001'}, or say "
            f"`unit: {'deg' if is_angle else 'mm'}` in the map of `comcal import`",
        )
    for joint, i, value in beyond:
        yield DataError(
            f"q.{joint.name} is far outside the limits of the joint",
            where=table.where(i),
            measured=f"{value:g}",
            limit=_range(joint),
            next_step="check the unit, sign and zero of this encoder, or the limits in the URDF",
        )


def _excess(joint: Joint, q: Array) -> Array:
    """Return by how much positions exceed the limits of a joint, its margin included."""
    is_angle = joint.kind is not JointType.PRISMATIC
    margin = LIMIT_MARGIN.get(joint.kind, ANGLE_MARGIN)
    lower, upper = joint.lower, joint.upper
    if is_angle:  # a joint without limits still does not wind up by more than a turn
        lower = lower if np.isfinite(lower) else -FULL_TURN
        upper = upper if np.isfinite(upper) else FULL_TURN
    return np.maximum(q - upper, lower - q) - margin


def _range(joint: Joint) -> str:
    unit = "m" if joint.kind is JointType.PRISMATIC else "rad"
    if not np.isfinite([joint.lower, joint.upper]).any():
        return f"+-2 pi {unit}"
    return f"{joint.lower:g} ... {joint.upper:g} {unit}"


def check_lengths(table: PoseTable, robot: Robot) -> Iterator[DataError]:
    """Yield CoM and CoP columns that cannot be metres, and an IMU that reads in g.

    Parameters
    ----------
    table : PoseTable
    robot : Robot
    """
    for name, values in (("com", table.com), ("cop", table.cop)):
        size = np.nan_to_num(np.abs(values))
        if size.size and size.max() > LARGEST_COM:
            i, k = np.unravel_index(int(size.argmax()), size.shape)
            yield UnitsError(
                f"{name}.{'xyz'[k]} looks like millimetres",
                where=table.where(int(i)),
                measured=f"{values[i, k]:g}",
                limit=f"{LARGEST_COM:g} m",
                next_step="multiply the column by 0.001, or say `unit: mm` in the map of "
                "`comcal import`",
            )
    size = np.linalg.norm(table.imu, axis=1)
    size = size[np.isfinite(size)]
    if size.size and abs(float(np.median(size)) - 1.0) < 0.2 and robot.gravity > 2.0:
        yield UnitsError(
            "the imu columns look like multiples of g",
            where=table.source.name if table.source else "",
            measured=f"median {np.median(size):.3g}",
            limit=f"{robot.gravity:g} m/s^2",
            next_step=f"multiply imu.* by {robot.gravity:g}, or say `unit: g` in the map of "
            "`comcal import`",
        )


def check_stillness(table: PoseTable, robot: Robot) -> Iterator[DataError]:
    """Yield poses whose own columns say that the robot moved.

    Parameters
    ----------
    table : PoseTable
    robot : Robot
    """
    weight = robot.tree.total_mass * robot.gravity
    for name, values in table.motion.items():
        limit, unit = _motion_limit(name, weight, robot.noise.ft_force)
        size = np.nan_to_num(np.abs(values))
        for i in np.flatnonzero(size > limit):
            yield NotStillError(
                f"{name} says that the robot moved",
                where=table.where(int(i)),
                measured=f"{values[i]:.3g} {unit}",
                limit=f"{limit:.3g} {unit}",
                next_step="measure the pose again, or drop it with use = 0",
            )


def _motion_limit(name: str, weight: float, noise: float) -> tuple[float, str]:
    """Return the limit of a motion column, infinite for those that say nothing about motion."""
    if name.startswith(("qd.", "slope.q.")):
        return LARGEST_VELOCITY, "rad/s"
    if name.startswith("sd.q."):
        return LARGEST_DEVIATION, "rad"
    if name.startswith("slope.ft.") and name.endswith((".fx", ".fy", ".fz")) and weight > 0.0:
        return max(LARGEST_FORCE_SLOPE * weight, SLOPE_NOISE * noise), "N/s"
    return np.inf, ""
