# SPDX-License-Identifier: Apache-2.0
"""The inner port of the simulators: a world in which the robot stands, without any sensor error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from comcal.measure.plan import PlannedPose
from comcal.robot.tree import Array


@dataclass(frozen=True)
class WorldState:
    """What is physically true at one instant.

    Parameters
    ----------
    t : float
        Time of the world [s].
    q : array, shape (n_joints,)
        Joint positions [rad] or [m].
    wrenches : mapping from sensor name to array, shape (6,)
        Force, moment of the part below the cut on the part above it, in and about the sensor
        frame [N, N m].
    torques : array, shape (n_joints,)
        Of parent on child about +axis [N m].
    imu : array, shape (3,) or None
        Specific force in the IMU link frame [m/s^2].
    com : array, shape (3,)
        CoM of the whole robot in the world frame [m]: the truth, for tests only.
    T_world_base : array, shape (4, 4)
        Pose of the root link.
    """

    t: float
    q: Array
    wrenches: Mapping[str, Array]
    torques: Array
    imu: Array | None
    com: Array
    T_world_base: Array


class World(Protocol):
    """A robot in a world; the engine behind it is nobody's business."""

    @property
    def name(self) -> str:
        """Engine and version."""
        ...

    def place(self, pose: PlannedPose) -> None:
        """Put the robot into *pose* (closed chains satisfied by the angles) and settle."""
        ...

    def advance(self, duration: float) -> None:
        """Let *duration* seconds pass."""
        ...

    def state(self) -> WorldState:
        """Return what is true now."""
        ...

    def close(self) -> None:
        """Release the engine."""
        ...
