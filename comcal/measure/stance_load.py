# SPDX-License-Identifier: Apache-2.0
"""What stands on the ground and what it should carry, roughly: for judging plausibility only.

The axes are x to the toes, y left, z the mean sole normal of the standing feet, with the origin
midway between their sensors: close to frame P, but no result rests on them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.plan import DOUBLE
from comcal.measure.table import PoseTable
from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Foot, Robot
from comcal.robot.tree import Array

NEGLIGIBLE = 0.1
"""A channel that was not measured counts as zero where it contributes less than this fraction;
tangential forces that were not measured count as zero anyway, since floors are nearly level."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class StanceLoad:
    """Measured and expected load of N poses; NaN where something needed was not measured.

    Parameters
    ----------
    force, moment : mapping from sensor or plate name to array, shape (N, 3)
        In the stance axes, about the stance origin [N, N m].
    standing : mapping from sensor or plate name to array of bool, shape (N,)
        Whether it carries one of the standing feet.
    mass : array, shape (N,)
        Mass of the links above the cuts of what stands [kg]; NaN where nothing does.
    com : array, shape (N, 3)
        Their centre of mass by the URDF, in the stance axes [m].
    corners : tuple of array or None, length N
        Corners of the standing soles, shape (n, 3), in the stance axes [m]; None when one is not
        known, or when a plate stands in the world at a place that only the user knows.
    """

    force: Mapping[str, Array]
    moment: Mapping[str, Array]
    standing: Mapping[str, Mask]
    mass: Array
    com: Array
    corners: tuple[Array | None, ...]

    def total_force(self) -> Array:
        """Return the force of all that stands, shape (N, 3); NaN where nothing does."""
        return self._sum(self.force)

    def total_moment(self) -> Array:
        """Return the moment of all that stands about the stance origin, shape (N, 3)."""
        return self._sum(self.moment)

    def line_of_gravity(self, height: Array) -> Array:
        """Return x and y of the line of action of the ground force at a height, shape (N, 2)."""
        force, moment = self.total_force(), self.total_moment()
        normal = np.where(np.abs(force[:, 2]) > 1.0, force[:, 2], np.nan)
        foot_point = np.column_stack([-moment[:, 1], moment[:, 0]]) / normal[:, None]
        return foot_point + force[:, :2] / normal[:, None] * height[:, None]

    def _sum(self, parts: Mapping[str, Array]) -> Array:
        total = np.zeros((len(self.mass), 3))
        for name, stands in self.standing.items():
            total += np.where(stands[:, None], parts[name], 0.0)
        total[np.isnan(self.mass)] = np.nan
        return total


def stance_load(table: PoseTable, robot: Robot) -> StanceLoad:
    """Compare what the feet carry with what they should carry.

    Parameters
    ----------
    table : PoseTable
    robot : Robot
        With a URDF and at least one foot.
    """
    n = len(table)
    placements = place_links(robot.tree, table.q)
    standing_feet = [
        [f for f in robot.feet.values() if support in (DOUBLE, f.name)] for support in table.support
    ]
    R_stance_root, p_stance = stance_frames(robot, placements, standing_feet)
    force: dict[str, Array] = {}
    moment: dict[str, Array] = {}
    standing: dict[str, Mask] = {}
    covered: list[set[str]] = [set() for _ in range(n)]
    for name in (*robot.sensors, *robot.plates):  # sensors first: a plate takes what they leave
        feet = _feet_of(robot, name)
        if name not in table.wrench or not feet:
            continue
        mask = np.array(
            [
                any(f in feet and f.name not in covered[i] for f in standing_feet[i])
                and not np.isnan(table.wrench[name][i]).all()
                for i in range(n)
            ],
            dtype=np.bool_,
        )
        for i in np.flatnonzero(mask):
            covered[i] |= {f.name for f in feet}
        standing[name] = mask
        force[name], moment[name] = _in_stance(
            robot, name, table.wrench[name], placements, R_stance_root, p_stance
        )
    mass, com = _carried(robot, placements, standing, R_stance_root, p_stance)
    complete = np.array(
        [
            bool(feet) and all(f.name in covered[i] for f in feet)
            for i, feet in enumerate(standing_feet)
        ],
        dtype=np.bool_,
    )
    mass = np.where(complete & (mass > 0.0), mass, np.nan)
    in_world = np.any(
        [
            standing[name]
            for name, plate in robot.plates.items()
            if name in standing and plate.frame == "world"
        ]
        + [np.zeros(n, dtype=np.bool_)],
        axis=0,
    )
    corners = tuple(
        None if in_world[i] else _corners(feet, placements, i, R_stance_root[i], p_stance[i])
        for i, feet in enumerate(standing_feet)
    )
    return StanceLoad(force, moment, standing, mass, com, corners)


def _feet_of(robot: Robot, name: str) -> list[Foot]:
    if name in robot.plates:
        return [f for f in robot.feet.values() if f.name in robot.plates[name].feet]
    return [f for f in robot.feet.values() if f.sensor == name]


def _sole(placements: Placements, foot: Foot) -> tuple[Array, Array]:
    R, p = placements.link(foot.link)
    return R @ foot.T_link_sole[:3, :3], p + apply(R, foot.T_link_sole[:3, 3])


def stance_frames(
    robot: Robot, placements: Placements, standing: list[list[Foot]]
) -> tuple[Array, Array]:
    """Return the stance axes and origin of N poses in the root frame.

    Parameters
    ----------
    robot : Robot
    placements : Placements
    standing : list of lists of Foot, length N
        The feet on the ground.

    Returns
    -------
    R_stance_root : array, shape (N, 3, 3)
        The axes x, y, z as rows.
    p_stance : array, shape (N, 3)
        The origin [m].
    """
    n = len(standing)
    R, p = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    soles = {f.name: _sole(placements, f) for f in robot.feet.values()}
    origins = {
        f.name: placements.joint(robot.sensors[f.sensor].joint)[1] if f.sensor else soles[f.name][1]
        for f in robot.feet.values()
    }
    for i, feet in enumerate(standing):
        if not feet:
            continue
        z = np.sum([soles[f.name][0][i, :, 2] for f in feet], axis=0)
        x = np.sum([soles[f.name][0][i, :, 0] for f in feet], axis=0)
        y = np.cross(z, x)
        if np.linalg.norm(z) > 0.0 and np.linalg.norm(y) > 0.0:
            z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
            R[i] = [np.cross(y, z), y, z]
        p[i] = np.mean([origins[f.name][i] for f in feet], axis=0)
    return R, p


def _in_stance(
    robot: Robot,
    name: str,
    wrench: Array,
    placements: Placements,
    R_stance_root: Array,
    p_stance: Array,
) -> tuple[Array, Array]:
    if name in robot.plates and robot.plates[name].frame == "world":
        return _level(wrench[:, :3]), wrench[:, 3:]
    R, p = (
        placements.link(robot.plates[name].frame)
        if name in robot.plates
        else placements.joint(robot.sensors[name].joint)
    )
    R_stance_sensor = R_stance_root @ R
    force = _level(_rotate_measured(R_stance_sensor, wrench[:, :3]))
    lever = apply(R_stance_root, p - p_stance)
    moment = _rotate_measured(R_stance_sensor, wrench[:, 3:]) + np.cross(lever, force)
    return force, moment


def _level(force: Array) -> Array:
    """Return forces whose unmeasured tangential parts are zero, as on a level floor."""
    is_known = np.isfinite(force[:, 2:])
    return np.where(np.isnan(force) & is_known, 0.0, force)


def _rotate_measured(R: Array, v: Array) -> Array:
    """Return ``R v``, NaN only where an unmeasured component of v matters."""
    missing = np.isnan(v)[:, None, :] & (np.abs(R) > NEGLIGIBLE)
    return np.where(missing.any(axis=2), np.nan, apply(R, np.nan_to_num(v)))


def _carried(
    robot: Robot,
    placements: Placements,
    standing: Mapping[str, Mask],
    R_stance_root: Array,
    p_stance: Array,
) -> tuple[Array, Array]:
    masses = robot.tree.masses
    is_above = np.ones((len(p_stance), len(masses)), dtype=np.bool_)
    for name, stands in standing.items():
        if name in robot.sensors:
            is_above[np.ix_(stands, robot.below_cut[name])] = False
    weights = np.where(is_above, masses, 0.0)
    mass = weights.sum(axis=1)
    first_moment = np.einsum("nk,nki->ni", weights, placements.coms)
    com = first_moment / np.where(mass > 0.0, mass, np.nan)[:, None]
    return mass, apply(R_stance_root, com - p_stance)


def _corners(
    feet: list[Foot], placements: Placements, i: int, R_stance_root: Array, p_stance: Array
) -> Array | None:
    corners: list[Array] = []
    for foot in feet:
        if foot.sole is None:
            return None
        R, p = _sole(placements, foot)
        flat = np.column_stack([foot.sole, np.zeros(len(foot.sole))])
        corners.append((p[i] + flat @ R[i].T - p_stance) @ R_stance_root.T)
    return np.vstack(corners) if corners else None
