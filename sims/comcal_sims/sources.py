# SPDX-License-Identifier: Apache-2.0
"""Entry points of the simulated sources: a world seen through a sensor adapter."""

from __future__ import annotations

from importlib.util import find_spec
from types import TracebackType

import numpy as np

from comcal.errors import ConfigError, MissingExtraError, UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.source import Block, SimulatedSource, SourceRequest
from comcal.robot.model import Robot
from comcal_sims.adapter import EXACT, SensorAdapter, sensor_errors_from
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.climate import Climate
from comcal_sims.faults.faulty_world import FaultyWorld
from comcal_sims.faults.support import hidden_changes
from comcal_sims.world import StagedWorld, World, WorldState

RATE = 120.0
"""Samples per second of world time."""
SLOT = 60.0
"""Seconds of session time that belong to each pose."""
_LIMIT_SLACK = 1e-9
"""Rounding allowed beyond a joint limit [rad] or [m]."""


class SampledWorld:
    """A world and its sensors as a :class:`~comcal.measure.source.SimulatedSource`.

    The session clock of pose i starts at ``SLOT * i``, whatever was measured before, so that even
    the times of a resumed recording are those of an uninterrupted one.

    Parameters
    ----------
    robot : Robot
    world : World
    adapter : SensorAdapter
    """

    def __init__(self, robot: Robot, world: World, adapter: SensorAdapter) -> None:
        self._robot = robot
        self._world = world
        self._adapter = adapter
        self._clock = 0.0

    @property
    def name(self) -> str:
        """Engine and version."""
        return self._world.name

    def move_to(self, pose: PlannedPose) -> None:
        """Place the robot in *pose* and let it settle.

        Raises
        ------
        UsageError
            If the pose lies outside the joint limits or cannot be stood in.
        """
        self._check_limits(pose)
        self._adapter.begin(pose.pose)
        self._clock = SLOT * pose.pose
        self._world.place(pose)

    def read(self, duration: float) -> Block:
        """Return the samples of the next *duration* seconds of world time, at least one.

        Raises
        ------
        UsageError
            If no pose was commanded yet.
        """
        states = list[WorldState]()
        for _ in range(max(1, round(duration * RATE))):
            self._world.advance(1.0 / RATE)
            states.append(self._world.state())
        t = self._clock + np.arange(1, len(states) + 1) / RATE
        self._clock = float(t[-1])
        return self._adapter.block(t, states)

    def close(self) -> None:
        """Release the engine."""
        self._world.close()

    def __enter__(self) -> SampledWorld:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _check_limits(self, pose: PlannedPose) -> None:
        tree = self._robot.tree
        for name, q in zip(tree.joint_names, pose.q, strict=True):
            joint = tree.joints[tree.joint_index[name]]
            if not joint.lower - _LIMIT_SLACK <= q <= joint.upper + _LIMIT_SLACK:
                raise UsageError(
                    f"joint {name} would leave its limits",
                    where=f"pose {pose.pose}",
                    measured=f"{q:.4f}",
                    limit=f"{joint.lower:.4f} to {joint.upper:.4f}",
                    next_step="correct the plan or the limits in the URDF",
                )


def open_builtin(request: SourceRequest) -> SimulatedSource:
    """Open the built-in statics world.

    Raises
    ------
    UsageError
        If unknown options, or effects that it cannot make, are asked for.
    """
    return _sampled(request, BuiltinWorld(request.robot), "builtin")


def open_pybullet(request: SourceRequest) -> SimulatedSource:
    """Open the pybullet world.

    Raises
    ------
    MissingExtraError
        If pybullet is not installed.
    UsageError
        If unknown options, or effects that it cannot make, are asked for.
    """
    if find_spec("pybullet") is None:
        raise MissingExtraError(
            "the source pybullet needs an engine that is not installed",
            where="--source pybullet",
            next_step="pip install 'comcal[sim]'; there are no wheels from Python 3.12 on: use "
            "--source mujoco (pip install 'comcal[mujoco]') or --source builtin there",
        )
    from comcal_sims.pybullet_world import PybulletWorld

    return _sampled(request, PybulletWorld(request.robot), "pybullet")


def open_mujoco(request: SourceRequest) -> SimulatedSource:
    """Open the MuJoCo world.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed.
    UsageError
        If unknown options, or effects that it cannot make, are asked for.
    """
    if find_spec("mujoco") is None:
        raise MissingExtraError(
            "the source mujoco needs an engine that is not installed",
            where="--source mujoco",
            next_step="pip install 'comcal[mujoco]', or use --source builtin",
        )
    from comcal_sims.mujoco_world import MujocoWorld

    return _sampled(request, MujocoWorld(request.robot), "mujoco")


def _sampled(request: SourceRequest, world: StagedWorld, source: str) -> SampledWorld:
    robot, options = request.robot, dict(request.options or {})
    climate = _climate(options, request)
    errors = sensor_errors_from(options, f"sources.{source}")
    errors = errors if request.noise else EXACT
    if not request.effects:
        return SampledWorld(robot, world, SensorAdapter(robot, errors, request.seed))
    try:
        changes = hidden_changes(request.effects, robot, source)
        faulty = FaultyWorld(world, robot, changes, request.plan)
    except UsageError:
        world.close()
        raise
    # Thermometers are there whatever is hidden: whether they matter must not be seen from outside.
    adapter = SensorAdapter(robot, errors, request.seed, changes, climate)
    return SampledWorld(robot, faulty, adapter)


def _climate(options: dict[str, object], request: SourceRequest) -> Climate:
    """Return the climate, taking its entries out of the *options* of a source."""
    known = {f"temperature_{name}": name for name in ("start", "rise", "time_constant")}
    known["temperature_cooling_from"] = "cooling_from"
    sizes = dict[str, float]()
    for option, name in known.items():
        value = options.pop(option, None)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1e6:
            raise ConfigError(
                f"{option} is {value!r}",
                where="sources",
                limit="a finite number, zero or more",
                next_step="give degrees Celsius, kelvins or seconds",
            )
        sizes[name] = float(value)
    first = SLOT * request.plan[0].pose if request.plan else 0.0
    return Climate(**sizes, first=first)
