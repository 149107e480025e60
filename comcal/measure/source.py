# SPDX-License-Identifier: Apache-2.0
"""The two ports of comcal: a :class:`Source` measures, a :class:`Commander` moves.

Whatever stands behind them (a CAN bus, a log, pybullet, MuJoCo, a ROS bag, plain statics) is found
by name in the entry-point groups ``comcal.sources`` and ``comcal.commanders``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Protocol, runtime_checkable

from comcal.errors import UsageError
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


@dataclass(frozen=True)
class SourceStatus:
    """How well the samples of a source arrive.

    Parameters
    ----------
    rates : mapping from name to float
        Samples (or frames) per second of every device, bus or channel, over the last seconds.
    lost : mapping from name to int
        What has been lost since the source was opened, by device and kind, such as
        ``l_foot lost`` or ``can0 bus-off``. Counts only grow.
    notes : tuple of str
        What else somebody at the robot should know, in words, such as
        ``can0: silent for 2.1 s, connecting again``.
    """

    rates: Mapping[str, float] = field(default_factory=dict[str, float])
    lost: Mapping[str, int] = field(default_factory=dict[str, int])
    notes: tuple[str, ...] = ()


@runtime_checkable
class CountingSource(Protocol):
    """A source that counts what it loses; others simply lack :meth:`status`."""

    def status(self) -> SourceStatus:
        """Return the state now; cheap, callable at any time between two reads."""
        ...


@runtime_checkable
class PoseAwareSource(Protocol):
    """A source that keeps files of its own by pose; others simply lack :meth:`begin_pose`."""

    def begin_pose(self, pose: int) -> None:
        """Take note that what is read from now on belongs to *pose*; called at every attempt."""
        ...


@runtime_checkable
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


class HardwareCommander(Commander, Protocol):
    """A commander of a real robot, as the entry points of ``comcal.commanders`` make it.

    :class:`comcal.measure.guard.GuardedCommander` stands before every one of them: what reaches
    ``move_to`` here is a planned pose within the limits of the URDF. One whose robot exists in a
    program only, and is in its pose at once, says so by an attribute ``is_emulated = True``: its
    speed is then not watched.
    """

    def stop(self) -> None:
        """Bring the robot to a halt where it is, now.

        Callable at any time, repeatedly, and from another thread than ``move_to``.
        """
        ...

    def close(self) -> None:
        """Stop, and release what the commander holds; callable repeatedly."""
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

    def refuse_effects(self) -> None:
        """Refuse to hide effects: for sources of what has really been measured.

        Raises
        ------
        UsageError
            If any are asked for.
        """
        if self.effects:
            raise UsageError(
                "effects can be hidden in simulated robots only",
                where="--effect",
                next_step="leave it out, or take a simulated source",
            )


@dataclass(frozen=True)
class CommanderRequest:
    """What an entry point of ``comcal.commanders`` is called with; it returns the commander.

    Parameters
    ----------
    robot : Robot
        The nominal robot, with the limits of its URDF.
    plan : tuple of PlannedPose
        All poses that will ever be commanded, via-poses among them.
    options : mapping
        ``commanders.<name>`` of robot.yaml; empty where there is none.
    speed : float
        Largest speed of any joint [rad/s] or [m/s].
    argument : str
        What follows the colon in ``--commander NAME:ARGUMENT``.
    source : Source or None
        The open source of the same recording, for commanders that share its bus.
    """

    robot: Robot
    plan: tuple[PlannedPose, ...]
    options: Mapping[str, object] = field(default_factory=dict[str, object])
    speed: float = 0.1
    argument: str = ""
    source: Source | None = None
