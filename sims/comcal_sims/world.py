# SPDX-License-Identifier: Apache-2.0
"""The inner port of the simulators: a world in which the robot stands, without any sensor error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from comcal.measure.plan import PlannedPose
from comcal.robot.model import Robot
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
    encoders : array, shape (n_joints,), or None
        Where the encoders are, if they do not sit at the joints [rad] or [m].
    motor_torques : array, shape (n_joints,), or None
        Of the motors, if friction lies between them and the joints [N m].
    """

    t: float
    q: Array
    wrenches: Mapping[str, Array]
    torques: Array
    imu: Array | None
    com: Array
    T_world_base: Array
    encoders: Array | None = None
    motor_torques: Array | None = None


def _no_stiffness() -> Array:
    return np.zeros((3, 3))


@dataclass(frozen=True)
class Load:
    """A force on a link that neither gravity nor the floor exerts, in world axes.

    Parameters
    ----------
    link : int
        Index in the tree.
    point : array, shape (3,)
        Where it attacks, in the link frame [m].
    force : array, shape (3,)
        While the point is at *anchor* [N].
    stiffness : array, shape (3, 3)
        The force falls by this times the way from *anchor* [N/m].
    anchor : array, shape (3,)
        In the world [m].
    """

    link: int
    point: Array
    force: Array
    stiffness: Array = field(default_factory=_no_stiffness)
    anchor: Array = field(default_factory=lambda: np.zeros(3))

    def at(self, point: Array) -> Array:
        """Return the force while the point is there in the world, shape (3,) [N]."""
        return self.force - self.stiffness @ (point - self.anchor)


@dataclass(frozen=True)
class Spring:
    """A spring between the motor of a joint, where its encoder is, and the joint itself.

    Parameters
    ----------
    stiffness : float
        [N m/rad]
    wound : float
        Joint minus motor with which a pose is begun; the engine finds its own [rad].
    """

    stiffness: float
    wound: float


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


class StagedWorld(World, Protocol):
    """A world whose robot, loads and commands can be changed, to hide effects in it."""

    def stand(self, robot: Robot) -> None:
        """Let *robot*, with the same joints, stand there from the next pose on."""
        ...

    def pull(self, loads: Sequence[Load]) -> None:
        """Let these forces act from the next pose on, instead of those before."""
        ...

    @property
    def stiffest_spring(self) -> float:
        """Largest stiffness that :meth:`soften` can make [N m/rad]; zero: none at all."""
        ...

    def soften(self, springs: Mapping[str, Spring]) -> None:
        """Put springs behind these joints from the next pose on, and remove all others."""
        ...

    def command(self, q: Array) -> None:
        """Move the motors' targets to *q*, shape (n_joints,) [rad] or [m]; time has to pass."""
        ...
