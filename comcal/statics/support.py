# SPDX-License-Identifier: Apache-2.0
"""Which sensors carry the robot in a kind of support, and which links they carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError, MissingColumnError
from comcal.measure.plan import DOUBLE, NONE
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array


@dataclass(frozen=True)
class Carrier:
    """What holds the robot up in one kind of support.

    Parameters
    ----------
    support : str
        ``double`` or the name of a foot.
    feet : tuple of str
        Standing feet, left before right.
    sensors : tuple of str
        Sensors (or plates) whose wrenches add up to the whole ground reaction above their cuts.
    frames : tuple of int or None
        Link in whose frame each of them measures; None: the stance frame P (a plate in the world).
    carried : array of bool, shape (n_links,)
        Links above every loaded cut. alpha..delta, m_2 and m_u speak of these only.
    """

    support: str
    feet: tuple[str, ...]
    sensors: tuple[str, ...]
    frames: tuple[int | None, ...]
    carried: npt.NDArray[np.bool_]


def carrier_of(robot: Robot, support: str) -> Carrier:
    """Return what carries *robot* in *support*.

    Foot sensors win over plates; a plate serves where a standing foot has no sensor of its own.

    Raises
    ------
    ConfigError
        If the support names no foot of the robot, or a standing foot has neither sensor nor plate.
    """
    if support == NONE:
        raise ConfigError("a hanging robot is carried by no sensor", where=f"support {support!r}")
    feet = standing_feet(robot, support)
    sensors: list[str] = []
    frames: list[int | None] = []
    carried = np.ones(len(robot.tree.links), dtype=np.bool_)
    for foot in feet:
        sensor = robot.feet[foot].sensor
        if sensor is not None:
            sensors.append(sensor)
            frames.append(robot.tree.joint_index[robot.sensors[sensor].joint] + 1)
            carried &= ~robot.below_cut[sensor]
            continue
        plate = next((p for p in robot.plates.values() if foot in p.feet), None)
        if plate is None:
            raise ConfigError(
                f"foot {foot!r} stands but has neither a sensor nor a plate",
                where=f"support {support!r}",
                next_step="add feet.*.sensor or plates to robot.yaml",
            )
        if plate.name not in sensors:
            sensors.append(plate.name)
            in_world = plate.frame == "world"
            frames.append(None if in_world else robot.tree.link_index[plate.frame])
    return Carrier(support, feet, tuple(sensors), tuple(frames), carried)


def standing_feet(robot: Robot, support: str) -> tuple[str, ...]:
    """Return the feet that stand, left before right (larger y at q = 0 first).

    Raises
    ------
    ConfigError
        If *support* names no foot.
    """
    if support == DOUBLE:
        feet = tuple(robot.feet)
        if not feet:
            raise ConfigError("double support of a robot without feet", where=robot.name)
        if "left" in feet and "right" in feet:
            return ("left", "right", *(f for f in feet if f not in ("left", "right")))
        return feet
    if support not in robot.feet:
        raise ConfigError(
            f"support {support!r} is neither 'double', 'none' nor a foot",
            where=robot.name,
            next_step=f"feet of this robot: {', '.join(robot.feet) or 'none'}",
        )
    return (support,)


def loaded_wrenches(carrier: Carrier, table: PoseTable) -> tuple[Array, Array]:
    """Return the wrenches of the loaded sensors, ground on robot, and their covariances.

    Returns
    -------
    w : array, shape (N, n_sensors, 6)
        In and about each sensor's own frame [N, N m].
    cov : array, shape (N, n_sensors, 6, 6)

    Raises
    ------
    MissingColumnError
        If the table holds no wrench of a loaded sensor.
    """
    absent = [s for s in carrier.sensors if s not in table.wrench]
    if absent:
        raise MissingColumnError(
            f"no wrench of sensor {absent[0]!r}, which is loaded in support {carrier.support!r}",
            where=str(table.source or "pose table"),
            next_step=f"add columns ft.{absent[0]}.fx .. tz",
        )
    w = np.stack([table.wrench[s] for s in carrier.sensors], axis=1)
    cov = np.stack([table.wrench_cov[s] for s in carrier.sensors], axis=1)
    return w, cov
