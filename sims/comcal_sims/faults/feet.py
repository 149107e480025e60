# SPDX-License-Identifier: Apache-2.0
"""Feet that do not stand as they should: shims, soft soles, an uneven floor, another place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from comcal.measure.plan import DOUBLE
from comcal.robot.changes import Change, feet_of
from comcal.robot.kinematics import place_links
from comcal.robot.model import Foot, Robot
from comcal.robot.tree import Array
from comcal_sims.faults.closure import Shift, on_wedge

Tilts = dict[str, tuple[float, float]]
"""Roll and pitch of each sole against the floor that loads have caused [rad]."""


class FootFaults:
    """What lies between soles and floor.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
    """

    def __init__(self, robot: Robot, changes: Sequence[Change]) -> None:
        self._robot = robot
        self._softness = {foot: np.zeros(2) for foot in robot.feet}
        self._wedges = {foot: np.zeros(3) for foot in robot.feet}
        self._unevenness = dict.fromkeys(robot.feet, 0.0)
        plane = {foot: np.zeros(3) for foot in robot.feet}
        for change in changes:
            if change.effect == "sole_compliance":
                for foot in feet_of(change, robot):
                    self._softness[foot] += change.numbers("tilt_x", "tilt_y")
            elif change.effect == "foot_placement":
                self._wedges[change.target] += change.numbers("z", "roll", "pitch")
                plane[change.target] += change.numbers("x", "y", "yaw")
            elif change.effect == "unknown" and change.words("function") == ("uneven_floor",):
                self._unevenness[change.target] += change.number("amplitude")
        self.shifts: Mapping[str, Shift] = {
            foot: Shift(*(float(value) for value in shift))
            for foot, shift in plane.items()
            if shift.any()
        }
        """How feet stand in the plane of the floor against where their angles put them."""

    @property
    def are_rigid(self) -> bool:
        """Whether no sole gives."""
        return not any(softness.any() for softness in self._softness.values())

    def no_tilts(self) -> Tilts:
        """Return the tilts of unloaded soles."""
        return dict.fromkeys(self._softness, (0.0, 0.0))

    def tilts(self, wrenches: Mapping[str, Array], support: str) -> Tilts:
        """Return how loaded soles tilt against the floor.

        Parameters
        ----------
        wrenches : mapping from sensor name to array, shape (6,)
            Of the ground on the robot, in and about the sensor frame [N, N m].
        support : str
        """
        found = self.no_tilts()
        for name, foot in self._robot.feet.items():
            if foot.sensor is None or support not in (DOUBLE, name):
                continue
            moment = self._sole_axes(foot).T @ wrenches[foot.sensor][3:]
            # The foot pushes back at the ground, and sinks in where it pushes.
            roll, pitch = -self._softness[name] * moment[:2]
            found[name] = (float(roll), float(pitch))
        return found

    def on_wedges(self, robot: Robot, pose: int, tilts: Tilts) -> Robot:
        """Return *robot* with all that lies below its soles fastened to them.

        Parameters
        ----------
        robot : Robot
        pose : int
            Its id: an uneven floor is another one in every pose.
        tilts : dict from foot name to tuple
        """
        feet = dict[str, Foot]()
        for number, (name, foot) in enumerate(robot.feet.items()):
            height, roll, pitch = self._wedges[name]
            if self._unevenness[name]:
                rng = np.random.default_rng([number, pose % 2**32])
                roll, pitch = (roll, pitch) + self._unevenness[name] * rng.standard_normal(2)
            roll, pitch = float(roll + tilts[name][0]), float(pitch + tilts[name][1])
            flat = height == 0.0 and roll == 0.0 and pitch == 0.0
            feet[name] = foot if flat else on_wedge(foot, float(height), roll, pitch)
        return replace(robot, feet=feet)

    def _sole_axes(self, foot: Foot) -> Array:
        """Return the axes of the sole in the frame of the foot's sensor, shape (3, 3)."""
        tree = self._robot.tree
        at = place_links(tree, np.zeros((1, len(tree.joint_names))))
        sensor = self._robot.sensors[str(foot.sensor)]
        R_root_sensor = at.joint(sensor.joint)[0][0]
        return R_root_sensor.T @ at.link(foot.link)[0][0] @ foot.T_link_sole[:3, :3]
