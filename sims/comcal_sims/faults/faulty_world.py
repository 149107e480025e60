# SPDX-License-Identifier: Apache-2.0
"""A world whose robot is not what its description says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import NotBalancedError
from comcal.measure.plan import NONE, PlannedPose
from comcal.robot.changes import Change
from comcal.robot.kinematics import place_links
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array
from comcal_sims.builtin_world import BuiltinWorld
from comcal_sims.faults.bodies import built_robot
from comcal_sims.faults.closure import Stance, closed_angles
from comcal_sims.faults.encoders import approach_signs, encoder_errors
from comcal_sims.faults.feet import FootFaults
from comcal_sims.faults.loads import loads_of
from comcal_sims.faults.series import SeriesElements
from comcal_sims.faults.sliding import slid
from comcal_sims.faults.stiction import Stiction
from comcal_sims.faults.sway import Sway
from comcal_sims.footing import base_in_world, standing_feet
from comcal_sims.world import Spring, StagedWorld, WorldState

SAME = 2e-6
"""Change of every deflection and tilt below which the robot has found its balance [rad]."""
ROUNDS = 12
"""Placements of the engine in search of it."""
FORECAST_ROUNDS = 60
"""The same in plain statics, from whose end the engine starts."""
TICK = 1.0 / 120.0
"""Of what is stepped along with the engine [s]."""


@dataclass(frozen=True)
class _Given:
    """What has given way so far: deflections and play of the joints, tilts of the soles."""

    deflection: Array
    play: Array
    tilts: dict[str, tuple[float, float]]

    def distance(self, other: _Given) -> float:
        """Return the largest change between the two [rad]."""
        tilts = [np.subtract(self.tilts[foot], other.tilts[foot]) for foot in self.tilts]
        return float(np.abs(np.concatenate([self.deflection - other.deflection, *tilts])).max())


class FaultyWorld:
    """A world with effects hidden in it; the engine behind it computes with the true robot.

    Bodies, lengths, sensor frames, forces, slopes and wedges are in the engine itself, and springs
    where it can make them. Whatever else yields between encoders and joints, and between feet and
    floor, follows the torques and wrenches that the engine reports, until nothing moves any more.
    Stiction and sway are stepped along with it.

    Parameters
    ----------
    world : StagedWorld
    robot : Robot
        As designed.
    changes : sequence of Change
        Effects on readings only are left to the sensors.
    plan : sequence of PlannedPose, optional
        In whose first pose on its feet tethers are measured. A recording that goes on in the midst
        of it has stood in all poses before.
    """

    def __init__(
        self,
        world: StagedWorld,
        robot: Robot,
        changes: Sequence[Change],
        plan: Sequence[PlannedPose] = (),
    ) -> None:
        self._world, self._changes = world, tuple(changes)
        self._robot = built_robot(robot, changes)
        self._series = SeriesElements(robot, changes)
        self._feet = FootFaults(robot, changes)
        self._stiction = Stiction(robot, changes)
        self._side = dict[str, int]()
        self._sway = Sway(robot, changes)
        self._plan = tuple(plan)
        self._anchors = dict[str, Array]()
        self._before: PlannedPose | None = None
        self._pose: PlannedPose | None = None
        self._errors = self._target = np.zeros(len(robot.tree.joint_names))

    @property
    def name(self) -> str:
        """Engine and version."""
        return self._world.name

    def place(self, pose: PlannedPose) -> None:
        """Send the robot to *pose*: its encoders will say that it is there.

        Raises
        ------
        UsageError
            If the angles cannot be closed, or the world cannot take the pose.
        NotBalancedError
            If the robot falls over, or finds no rest.
        """
        if self._pose is None:
            self._walk_to(pose)
        elif self._pose.pose != pose.pose:
            self._before = self._pose
        self._pose = pose
        pose = self._on_true_floor(pose)
        approach = self._arrivals(approach_signs(self._robot, pose, self._before))
        fixed = encoder_errors(self._robot, self._changes, pose.q, approach)
        given = self._balanced(pose, fixed)
        self._errors = fixed + given.deflection
        if not self._stiction.is_absent:
            sides = [approach[name] for name in self._robot.tree.joint_names]
            self._stiction.arrive(self._world.state().q, np.array(sides, dtype=np.float64))
        if not self._sway.is_absent:
            at, robot = self._target, self._standing(pose, given)
            self._sway.start(at, lambda q: self._closed(pose, robot, q, at))

    def advance(self, duration: float) -> None:
        """Let *duration* seconds pass."""
        if self._sway.is_absent and self._stiction.is_absent:
            self._world.advance(duration)
            return
        while duration > 1e-9:
            tick = min(duration, TICK)
            duration -= tick
            if not self._sway.is_absent:
                self._world.command(self._sway.after(tick))
            self._tick(tick)

    def state(self) -> WorldState:
        """Return what is true now, and where encoders and motors differ from the joints."""
        state = self._world.state()
        motors = None
        if not self._stiction.is_absent:
            motors = state.torques + self._stiction.beside(state.torques)
        at = state.q if state.encoders is None else state.encoders
        return replace(state, encoders=at - self._errors, motor_torques=motors)

    def close(self) -> None:
        """Release the engine."""
        self._world.close()

    def _walk_to(self, pose: PlannedPose) -> None:
        """Remember from which sides joints came in the poses of the plan before this one."""
        ids = [planned.pose for planned in self._plan]
        for earlier in self._plan[: ids.index(pose.pose) if pose.pose in ids else 0]:
            self._arrivals(approach_signs(self._robot, earlier, self._before))
            self._before = earlier

    def _arrivals(self, approach: Mapping[str, int]) -> Mapping[str, int]:
        """Return from which side joints came last: play and stiction of one at rest stay."""
        self._side.update({name: side for name, side in approach.items() if side})
        return {name: self._side.get(name, 0) for name in approach}

    def _on_true_floor(self, pose: PlannedPose) -> PlannedPose:
        if self._robot.base is Base.FIXED:
            return replace(pose, support=NONE)
        tilt = np.sum(
            [c.numbers("roll", "pitch") for c in self._changes if c.effect == "ground_tilt"]
            or [[0.0, 0.0]],
            axis=0,
        )
        return replace(
            pose,
            floor_roll=pose.floor_roll + float(tilt[0]),
            floor_pitch=pose.floor_pitch + float(tilt[1]),
        )

    def _standing(self, pose: PlannedPose, given: _Given) -> Robot:
        """Return the robot on the wedges of this pose."""
        return self._feet.on_wedges(self._robot, pose.pose, given.tilts)

    def _closed(
        self, pose: PlannedPose, robot: Robot, q: Array, stuck_at: Array | None = None
    ) -> Array:
        stance = Stance(standing_feet(robot, pose.support), self._feet.shifts, stuck_at)
        return closed_angles(robot, stance, q, f"pose {pose.pose}")

    def _balanced(self, pose: PlannedPose, fixed: Array) -> _Given:
        """Place the robot, and return what has given way beside the springs of the engine."""
        nothing = np.zeros(pose.q.size)
        given = _Given(nothing, nothing, self._feet.no_tilts())
        wound = springs = nothing
        if not (self._series.are_rigid and self._feet.are_rigid):
            forecast = BuiltinWorld(self._robot)
            given = self._balance(forecast, pose, fixed, given, nothing, nothing)
            springs = self._series.springs(self._world.stiffest_spring)
            wound = -springs * forecast.state().torques
            given = replace(given, deflection=given.deflection - wound)
        return self._balance(self._world, pose, fixed, given, springs, wound)

    def _balance(
        self,
        world: StagedWorld,
        pose: PlannedPose,
        fixed: Array,
        given: _Given,
        springs: Array,
        wound: Array,
    ) -> _Given:
        """Place the robot until what gives has given way to the loads that it feels."""
        is_forecast = world is not self._world
        for _ in range(FORECAST_ROUNDS if is_forecast else ROUNDS):
            state = self._put(world, pose, fixed + given.deflection, given, springs, wound)
            deflection, play = self._series.deflection(state.torques, given.play, springs)
            tilts = self._feet.tilts(state.wrenches, pose.support)
            found = _Given(deflection, play, tilts)
            # The robot stands with the old values, which its encoders have to be told.
            if found.distance(given) < SAME:
                return given
            given = found
        if is_forecast:
            return given
        raise NotBalancedError(
            "the joints or soles that give find no rest",
            where=f"pose {pose.pose}",
            limit=f"{ROUNDS} rounds",
            next_step="take stiffer springs, or another pose",
        )

    def _put(
        self,
        world: StagedWorld,
        pose: PlannedPose,
        errors: Array,
        given: _Given,
        springs: Array,
        wound: Array,
    ) -> WorldState:
        robot = self._standing(pose, given)
        true = replace(pose, q=self._closed(pose, robot, pose.q + errors + wound))
        self._target = true.q
        robot = slid(robot, self._changes, true)
        self._remember_anchors(true, robot)
        world.stand(robot)
        world.soften(
            {
                name: Spring(1.0 / compliance, start)
                for name, compliance, start in zip(
                    robot.tree.joint_names, springs.tolist(), wound.tolist(), strict=True
                )
                if compliance > 0.0
            }
        )
        world.pull(loads_of(robot, self._changes, true, self._anchors))
        world.place(true)
        return world.state()

    def _remember_anchors(self, pose: PlannedPose, robot: Robot) -> None:
        tethered = [c.target for c in self._changes if c.effect == "tether"]
        first = next((p for p in self._plan if p.support != NONE), pose)
        if not tethered or self._anchors or first.support == NONE:
            return
        level = replace(first, floor_roll=0.0, floor_pitch=0.0)
        T = base_in_world(robot, level)
        at = place_links(robot.tree, level.q)
        for link in tethered:
            self._anchors[link] = T[:3, :3] @ at.link(link)[1][0] + T[:3, 3]

    def _tick(self, duration: float) -> None:
        self._world.advance(duration)
        if not self._stiction.is_absent:
            self._stiction.step(self._world.state().q)
