# SPDX-License-Identifier: Apache-2.0
"""Where P is when soles give way, and how well two standing feet fit one floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.frames import apply, cross, rotation_from_rpy, skew
from comcal.robot.kinematics import Placements
from comcal.robot.tree import Array
from comcal.statics.stance import sensor_origin
from comcal.statics.support import Carrier


@dataclass(frozen=True)
class Standing:
    """The stance frame of N poses.

    Parameters
    ----------
    R_root_P, p_root_P : array, shape (N, 3, 3), (N, 3)
        P in the root frame.
    closure : array, shape (N, 3), or None
        Of two feet: lean of the right sole's normal against the left one's about x and y of P
        [rad], and how much higher the right sole is along z of P [m].
    """

    R_root_P: Array
    p_root_P: Array  # noqa: N815
    closure: Array | None


def standing_at(assumed: Assumed, table: PoseTable, carrier: Carrier, at: Placements) -> Standing:
    """Return the stance frame of poses in one support, of soles that may give way.

    A foot that leans against the floor by a small rotation t, in its own sole axes, has the floor's
    normal at R (1 - t x) e_z instead of R e_z. It sinks where it is loaded: t = -give M, M the
    moment of the ground on the robot.
    """
    robot = assumed.robot
    axes: list[Array] = []
    origins: list[Array] = []
    soles: list[Array] = []
    for name in carrier.feet:
        foot = robot.feet[name]
        R, p = at.link(foot.link)
        R_sole = R @ foot.T_link_sole[:3, :3]
        give = assumed.sole_give.get(name)
        if give is not None and foot.sensor is not None and foot.sensor in table.wrench:
            tilt = _moment_at_sole(assumed, table, name, at, R_sole) * give
            turn = np.stack([tilt[:, 0], tilt[:, 1], np.zeros(len(tilt))], axis=1)
            R_sole = R_sole @ (np.eye(3) + skew(turn))
        axes.append(R_sole)
        soles.append(p + apply(R, foot.T_link_sole[:3, 3]))
        origins.append(sensor_origin(robot, name, at))
    if len(axes) == 1:
        return Standing(axes[0], origins[0], None)
    z = _unit(np.sum([R[..., 2] for R in axes], axis=0))
    across = origins[0] - origins[-1]
    y = _unit(across - np.sum(across * z, axis=1, keepdims=True) * z)
    R_root_P = np.stack([cross(y, z), y, z], axis=-1)
    lean = cross(axes[0][..., 2], axes[-1][..., 2])
    height = np.sum((soles[-1] - soles[0]) * z, axis=1)
    in_P = apply(np.swapaxes(R_root_P, 1, 2), lean)
    closure = np.column_stack([in_P[:, :2], height])
    return Standing(R_root_P, np.mean(origins, axis=0), closure)


def world_axes(up: Array) -> Array:
    """Return R_root_world of a hanging robot that is not turned about the vertical, (N, 3, 3).

    Parameters
    ----------
    up : array, shape (N, 3)
        Upward vector in the root frame; where it is unknown, the robot counts as upright.
    """
    x, y, z = np.nan_to_num(up).T
    rpy = [np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z)), np.zeros(len(up))]
    return np.swapaxes(rotation_from_rpy(np.stack(rpy, axis=-1)), 1, 2)


def _moment_at_sole(
    assumed: Assumed, table: PoseTable, name: str, at: Placements, R_sole: Array
) -> Array:
    """Return the measured moment about x and y of the sole at its sensor, shape (N, 2) [N m]."""
    foot = assumed.robot.feet[name]
    sensor = assumed.robot.sensors[str(foot.sensor)]
    R_root_sensor, _ = at.joint(sensor.joint)
    moment = apply(R_root_sensor, table.wrench[sensor.name][:, 3:])
    return apply(np.swapaxes(R_sole, 1, 2), moment)[:, :2]


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
