# SPDX-License-Identifier: Apache-2.0
"""Where the ground pushes: the centre of pressure of every raw sample, for judging stillness.

A calibration never uses these numbers, so they may be rough: the sole is taken as flat, tares are
not subtracted, and all samples share the joint angles of the last ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.measure.plan import DOUBLE, NONE
from comcal.measure.source import Block
from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Foot, Plate, Robot, Sense
from comcal.robot.tree import Array


@dataclass(frozen=True)
class CenterOfPressure:
    """The path of the centre of pressure of some loaded sensors together.

    Parameters
    ----------
    xy : array, shape (n, 2)
        In the plane of the soles, to the toes and to the left [m]; NaN where no force acts.
    force : array, shape (n,)
        Normal force, whatever its sign [N].
    sensors : tuple of str
        The sensors or plates it was summed over.
    """

    xy: Array
    force: Array
    sensors: tuple[str, ...]


def centers_of_pressure(
    block: Block, robot: Robot, support: str, last: int
) -> tuple[CenterOfPressure, ...]:
    """Return the centre of pressure under the loaded feet.

    Parameters
    ----------
    block : Block
    robot : Robot
    support : str
        ``double``, ``none`` or a foot.
    last : int
        Number of samples at the end whose mean joint positions place the sensors.

    Returns
    -------
    tuple of CenterOfPressure
        One of all loaded sensors together, so that the split between two flat feet, which statics
        does not determine, cannot disturb it; a second one for force plates that stand in the
        world, whose place relative to the robot need not be known. Empty when nothing that is
        measured carries the robot.
    """
    feet = _standing(robot, support)
    if not feet:
        return ()
    placements = place_links(robot.tree, block.q[-last:].mean(axis=0))
    axes = _sole_axes(placements, feet)
    by_sensor = [f.sensor for f in feet if f.sensor is not None and f.sensor in block.wrenches]
    plates = [
        plate
        for plate in robot.plates.values()
        if plate.name in block.wrenches
        and any(f.name in plate.feet and f.sensor not in by_sensor for f in feet)
    ]
    on_links = [plate for plate in plates if plate.frame != "world"]
    in_world = [plate for plate in plates if plate.frame == "world"]
    found: list[CenterOfPressure] = []
    if by_sensor or on_links:
        force, moment = _total_in_root(block, robot, placements, by_sensor, on_links)
        names = (*by_sensor, *(plate.name for plate in on_links))
        found.append(_center(force @ axes.T, moment @ axes.T, names))
    if in_world:
        total = np.sum([block.wrenches[plate.name] for plate in in_world], axis=0)
        names = tuple(plate.name for plate in in_world)
        found.append(_center(total[:, :3], total[:, 3:], names))
    return tuple(found)


def _standing(robot: Robot, support: str) -> tuple[Foot, ...]:
    if support == NONE:
        return ()
    return tuple(foot for foot in robot.feet.values() if support in (DOUBLE, foot.name))


def _sole_axes(placements: Placements, feet: tuple[Foot, ...]) -> Array:
    """Return x (to the toes), y, z (mean sole normal) as rows, in the root frame."""
    soles = np.array([placements.link(f.link)[0][0] @ f.T_link_sole[:3, :3] for f in feet])
    z = soles[:, :, 2].sum(axis=0)
    z /= np.linalg.norm(z)
    y = np.cross(z, soles[:, :, 0].sum(axis=0))
    y /= np.linalg.norm(y)
    return np.array([np.cross(y, z), y, z])


def _total_in_root(
    block: Block, robot: Robot, placements: Placements, sensors: list[str], plates: list[Plate]
) -> tuple[Array, Array]:
    """Return the total force and its moment about the middle of the sensor origins."""
    frames = [(name, *placements.joint(robot.sensors[name].joint)) for name in sensors]
    frames += [(plate.name, *placements.link(plate.frame)) for plate in plates]
    middle = np.mean([p[0] for _, _, p in frames], axis=0)
    force = np.zeros((block.t.size, 3))
    moment = np.zeros((block.t.size, 3))
    for name, R, p in frames:
        sensor = robot.sensors.get(name)
        sign = -1.0 if sensor is not None and sensor.sense is Sense.ON_GROUND else 1.0
        f = sign * apply(R[0], block.wrenches[name][:, :3])
        force += f
        moment += sign * apply(R[0], block.wrenches[name][:, 3:]) + np.cross(p[0] - middle, f)
    return force, moment


def _center(force: Array, moment: Array, names: tuple[str, ...]) -> CenterOfPressure:
    """Return z x M / F_z, the point of the sole plane about which M has no tangential part."""
    normal = np.where(force[:, 2] == 0.0, np.nan, force[:, 2])
    xy = np.stack([-moment[:, 1], moment[:, 0]], axis=1) / normal[:, None]
    return CenterOfPressure(xy, np.abs(force[:, 2]), names)
