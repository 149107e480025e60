# SPDX-License-Identifier: Apache-2.0
"""The two ports of comcal: a :class:`Source` measures, a :class:`Commander` moves.

Whatever stands behind them (a CAN bus, a log, pybullet, MuJoCo, a ROS bag, plain statics) is found
by name in the entry-point groups ``comcal.sources`` and ``comcal.commanders``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

from comcal.measure.plan import PlannedPose
from comcal.robot.model import Robot
from comcal.robot.tree import Array


@dataclass(frozen=True)
class Block:
    """Consecutive raw samples of every channel, on one clock.

    Parameters
    ----------
    t : array, shape (n,)
        Time of each sample since the start of the session [s], increasing.
    q : array, shape (n, n_joints)
        Joint positions as the encoders report them, in the order of ``tree.joint_names``.
    wrenches : mapping from sensor or plate name to array, shape (n, 6)
        Force then moment [N, N m] as the sensor reports it: before tare, in its own ``sense``.
    torques : array, shape (n, n_joints) or None
        Joint torque of parent on child about +axis [N m]; NaN where unknown.
    currents : array, shape (n, n_joints) or None
        Motor currents [A]; NaN where there is no motor.
    imu : array, shape (n, 3) or None
        Specific force in the IMU link frame [m/s^2]; (0, 0, +9.81) at rest and level.
    temperatures : mapping from sensor name to array, shape (n,)
        [deg C]; empty where not measured.
    """

    t: Array
    q: Array
    wrenches: Mapping[str, Array]
    torques: Array | None = None
    currents: Array | None = None
    imu: Array | None = None
    temperatures: Mapping[str, Array] | None = None


class Source(Protocol):
    """Something that measures the robot."""

    @property
    def name(self) -> str:
        """Short name for the session file, such as ``pybullet 3.2.7``."""
        ...

    def read(self, duration: float) -> Block:
        """Return the samples of the next *duration* seconds of the source's own clock."""
        ...

    def close(self) -> None:
        """Release what the source holds; reading afterwards is an error."""
        ...


class Commander(Protocol):
    """Something that moves the robot; by default a person, in simulation the simulator."""

    def move_to(self, pose: PlannedPose) -> None:
        """Start moving to *pose*; whether the robot has arrived and is still, the readings tell.

        Raises
        ------
        UsageError
            If the pose lies outside the joint limits or is not in the planned list.
        """
        ...


class SimulatedSource(Source, Commander, Protocol):
    """A simulated world is both ports at once."""

    def __enter__(self) -> SimulatedSource: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@dataclass(frozen=True)
class SourceRequest:
    """What an entry point of ``comcal.sources`` is called with.

    Parameters
    ----------
    robot : Robot
        The nominal robot; ``robot.urdf_path`` names its URDF.
    seed : int
        Master seed of simulated noise; ``move_to`` derives an own stream from it for every pose,
        so that an interrupted and resumed recording equals an uninterrupted one.
    argument : str
        What follows the colon in ``--source replay:FILE``.
    effects : tuple of str
        ``--effect`` arguments; only simulated sources accept any.
    noise : bool
        False switches the sensor adapters' noise, bias and quantisation off (engine values).
    options : mapping
        ``sources.<name>`` of robot.yaml.
    plan : tuple of PlannedPose
        All poses of the session, for what counts from the first one; empty where nobody knows.
    """

    robot: Robot
    seed: int
    argument: str = ""
    effects: tuple[str, ...] = ()
    noise: bool = True
    options: Mapping[str, object] | None = None
    directory: Path | None = None
    plan: tuple[PlannedPose, ...] = ()
