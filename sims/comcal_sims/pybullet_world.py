# SPDX-License-Identifier: Apache-2.0
"""The robot standing in pybullet, an engine with hard contacts and ideal servos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Literal

import numpy as np

from comcal.errors import UsageError
from comcal.measure.plan import NONE, PlannedPose
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array, JointType
from comcal_sims.conventions import check_standing, specific_force
from comcal_sims.engines import import_engine, silenced
from comcal_sims.footing import base_in_world
from comcal_sims.pybullet_body import FRICTION, BulletBody
from comcal_sims.pybullet_urdf import bullet_urdf
from comcal_sims.rotations import floor_rotation, quaternion_xyzw
from comcal_sims.springless import Springless
from comcal_sims.world import Load, WorldState

TIME_STEP = 1 / 240
"""[s]"""
HELD_TIME_STEP = 1 / 1920
"""Of a robot that hangs [s]. pybullet lets everything fall for one step before its motors catch it,
and its force sensors feel what that step would have turned into centrifugal forces."""
HELD_SETTLE = 0.25
"""Longest settling time of a robot that hangs [s]: nothing rocks, from 0.05 s on its wrenches
and torques are the same to the last digits, and a joint too weak to hold has given way."""
REGULARISATION = 1e-8
"""Constraint force mixing of the direct solver: makes the statically indeterminate shares of two
feet unique. Ten times more would do; the creep down a slope grows with it."""
ITERATIONS = 300
"""Of the iterative solver under compliant soles."""
PAD_STIFFNESS = 350.0
"""Of the pad under one corner, in weights of the robot per metre. At half of it a robot of human
size on one foot rocks for seconds."""
PAD_DAMPING = 0.1
"""Damping over stiffness of a pad [s]."""
_ALL_JOINT_FEEDBACK = 3
"""Wrenches about the joint in the axes of the world: the one mode free of inertial frames."""


class PybulletWorld(Springless):
    """A robot in pybullet, without any sensor error.

    Parameters
    ----------
    robot : Robot
        Its tree is what stands there; the soles of its feet are the only surfaces.
    settle : float
        Time given to every new pose before it counts [s]; a robot that hangs needs no more than
        :data:`HELD_SETTLE`.
    contact : {"rigid", "compliant"}
        Hard ground, or a spring under each corner of a sole. A robot of human size rocks on
        springs: let it settle for 1.5 s on two feet, for 3 s on one.

    Raises
    ------
    MissingExtraError
        If pybullet is not installed.
    UsageError
        If the robot has sliding joints: sensors below one would read nonsense.

    Notes
    -----
    Rigid contact is solved directly (Dantzig). The iterative default needs over 1000 rounds per
    step for a robot of 60 kg to stop rocking on a slope. The direct solver ignores contact springs,
    so compliant soles are left to the iterative one.

    Where several feet stand, the share of each is statically indeterminate: only sums have a
    meaning. Every pose starts from an empty world, so the same pose gives the same state to the
    last bit, whatever came before.
    """

    def __init__(
        self,
        robot: Robot,
        settle: float = 0.75,
        contact: Literal["rigid", "compliant"] = "rigid",
    ) -> None:
        _refuse_sliders(robot)
        self._robot, self._settle, self._contact = robot, settle, contact
        self._urdf = bullet_urdf(robot)
        self._p, self._version = import_engine("pybullet", "sim")
        self._client: int | None = self._p.connect(self._p.DIRECT)
        self._body: BulletBody | None = None
        self._loads: tuple[Load, ...] = ()
        self._step, self._clock, self._steps = TIME_STEP, 0.0, 0
        self._state: WorldState | None = None
        """What was read since the last step."""

    @property
    def name(self) -> str:
        """Engine and version."""
        return f"pybullet {self._version}"

    def place(self, pose: PlannedPose) -> None:
        """Put the robot into *pose*, its standing soles flat on the floor, and settle.

        Raises
        ------
        UsageError
            If the robot has no such support, or its feet are not where that support needs them.
        NotBalancedError
            If the robot falls over.
        """
        if self._robot.base is Base.FIXED:
            pose = replace(pose, support=NONE)
        T_world_base = base_in_world(self._robot, pose)
        self._start_afresh(held=pose.support == NONE)
        if pose.support != NONE:
            self._lay_floor(pose)
        self._body = BulletBody(
            self._p, self._open_client(), self._robot, self._urdf, held=pose.support == NONE
        )
        if self._contact == "compliant":
            weight = self._robot.tree.total_mass * self._robot.gravity
            self._body.soften(PAD_STIFFNESS * weight, PAD_DAMPING * PAD_STIFFNESS * weight)
        self._body.put(T_world_base, pose.q)
        settle = min(self._settle, HELD_SETTLE) if pose.support == NONE else self._settle
        self.advance(max(settle, self._step))
        check_standing(pose, T_world_base, self._body.link_frame(0))

    def advance(self, duration: float) -> None:
        """Let *duration* seconds pass; steps are made when they are due, so any length will do."""
        body, client = self._require_pose(), self._open_client()
        self._clock += duration
        self._state = None
        due = int(np.floor(self._clock / self._step + 1e-6))
        for _ in range(due - self._steps):
            for load in self._loads:
                body.pull(load)
            self._p.stepSimulation(physicsClientId=client)
        self._steps = due

    def stand(self, robot: Robot) -> None:
        """Let another robot with the same joints stand there from the next pose on."""
        if robot is self._robot:
            return
        _refuse_sliders(robot)
        self._robot, self._urdf = robot, bullet_urdf(robot)

    def pull(self, loads: Sequence[Load]) -> None:
        """Let these forces act from the next pose on."""
        self._loads = tuple(loads)

    def command(self, q: Array) -> None:
        """Send the motors there.

        Parameters
        ----------
        q : array, shape (n_joints,)
            [rad]
        """
        self._require_pose().command(q)
        self._state = None

    def state(self) -> WorldState:
        """Return what is true now; ``t`` counts from the moment the pose was placed.

        Raises
        ------
        UsageError
            If no pose was placed yet, or the world is closed.
        """
        body, robot = self._require_pose(), self._robot
        if self._state is not None:
            return self._state
        q, torques = body.joint_state()
        imu = None
        if robot.imu_link is not None:
            T_world_imu = body.link_frame(robot.tree.link_index[robot.imu_link])
            imu = specific_force(robot, T_world_imu[:3, :3])
        self._state = WorldState(
            t=self._clock,
            q=q,
            wrenches={sensor: body.wrench(sensor) for sensor in robot.sensors},
            torques=torques,
            imu=imu,
            com=body.com(),
            T_world_base=body.link_frame(0),
        )
        return self._state

    def close(self) -> None:
        """Release the engine; closing twice is harmless."""
        if self._client is not None:
            self._p.disconnect(physicsClientId=self._client)
        self._client = self._body = self._state = None

    def __enter__(self) -> PybulletWorld:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _require_pose(self) -> BulletBody:
        self._open_client()
        if self._body is None:
            raise UsageError(
                "there is no state", where=self.name, next_step="place the robot in a pose first"
            )
        return self._body

    def _open_client(self) -> int:
        if self._client is None:
            raise UsageError("the world is closed", where=self.name, next_step="open a new one")
        return self._client

    def _start_afresh(self, *, held: bool) -> None:
        """Empty the world and its memory: what came before must not matter in the last bit."""
        p, client = self._p, self._open_client()
        self._step = HELD_TIME_STEP if held else TIME_STEP
        self._clock, self._steps = 0.0, 0
        self._body = self._state = None
        p.resetSimulation(physicsClientId=client)
        p.setGravity(0, 0, -self._robot.gravity, physicsClientId=client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            numSolverIterations=ITERATIONS,
            numSubSteps=0,  # with sub-steps contact forces and motor torques come out divided
            solverResidualThreshold=0,
            jointFeedbackMode=_ALL_JOINT_FEEDBACK,
            physicsClientId=client,
        )
        if self._contact == "rigid":
            with silenced():  # pybullet prints the name of the solver
                p.setPhysicsEngineParameter(
                    constraintSolverType=p.CONSTRAINT_SOLVER_LCP_DANTZIG,
                    globalCFM=REGULARISATION,
                    physicsClientId=client,
                )

    def _lay_floor(self, pose: PlannedPose) -> None:
        p, client = self._p, self._open_client()
        # a plane, not a box: against a box pybullet reports contact points 0.015 mm off
        shape = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
        orientation = quaternion_xyzw(floor_rotation(pose.floor_roll, pose.floor_pitch))
        floor: int = p.createMultiBody(
            0, shape, baseOrientation=orientation.tolist(), physicsClientId=client
        )
        p.changeDynamics(floor, -1, lateralFriction=FRICTION, physicsClientId=client)


def _refuse_sliders(robot: Robot) -> None:
    """Raise for sliding joints.

    pybullet lets a sliding motor push with two forces on two different lines, at the CoMs of its
    two links, and reports their couple as a load of every sensor below.
    """
    for joint in robot.tree.joints:
        if joint.kind is JointType.PRISMATIC:
            raise UsageError(
                f"pybullet misreads force sensors of robots with sliding joints ({joint.name})",
                where=robot.name,
                next_step="use the source mujoco or builtin",
            )
