# SPDX-License-Identifier: Apache-2.0
"""The robot standing in MuJoCo, an engine with springy contacts and servos of finite stiffness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np

from comcal.errors import UsageError
from comcal.measure.plan import NONE, PlannedPose
from comcal.robot.frames import transform_from
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array
from comcal_sims.conventions import (
    check_standing,
    generalised_torques,
    joint_name,
    joint_targets,
    link_name,
    on_part_above,
    specific_force,
)
from comcal_sims.engines import import_engine
from comcal_sims.footing import base_in_world
from comcal_sims.mujoco_xml import SERVO_STIFFNESS, TIME_STEP, force_name, mujoco_xml, torque_name
from comcal_sims.rotations import floor_rotation
from comcal_sims.world import Load, Spring, WorldState

TRIMS = 4
"""How often the servos make up for their sag while a pose settles."""
TRIMMING = 0.6
"""Share of the settling time in which they do; the rest is for coming to rest."""
SPRING_SETTLE = 1.5
"""Further time for a robot with springs in its joints [s]."""
LOADED_STEPS = 5
"""After which external forces on links are taken anew; they change as slowly as links move."""


class MujocoWorld:
    """A robot in MuJoCo, without any sensor error.

    Parameters
    ----------
    robot : Robot
        Its tree is what stands there; the soles of its feet are the only surfaces.
    settle : float
        Time given to every new pose before it counts [s].

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.

    Notes
    -----
    Servos are springs, so a joint sags by torque / stiffness, some 0.1 degree. As a position
    controller with integral action would, they shift their targets while settling until the joints
    are where they were commanded; afterwards the targets rest.

    Every pose is compiled afresh, so the same pose gives the same state to the last bit, whatever
    came before. Where several feet stand, only the sums of their loads have a meaning.
    """

    def __init__(self, robot: Robot, settle: float = 2.0) -> None:
        self._robot, self._settle = robot, settle
        self._mujoco, self._version = import_engine("mujoco", "mujoco")
        self._model: Any = None
        self._data: Any = None
        self._clock, self._steps = 0.0, 0
        self._loads: tuple[Load, ...] = ()
        self._springs = dict[str, Spring]()
        self._wanted = dict[str, float]()
        self._closed = False

    @property
    def name(self) -> str:
        """Engine and version."""
        return f"mujoco {self._version}"

    def place(self, pose: PlannedPose) -> None:
        """Put the robot into *pose*, its standing soles flat on the floor, and settle.

        Raises
        ------
        UsageError
            If the robot has no such support, or its feet are not where that support needs them.
        NotBalancedError
            If the robot falls over.
        """
        if self._closed:
            raise UsageError("the world is closed", where=self.name, next_step="open a new one")
        robot = self._robot
        if robot.base is Base.FIXED:
            pose = replace(pose, support=NONE)
        T_world_base = base_in_world(robot, pose)
        floor = None
        if pose.support != NONE:
            floor = floor_rotation(pose.floor_roll, pose.floor_pitch)
        self._model = self._mujoco.MjModel.from_xml_string(
            mujoco_xml(
                robot,
                T_world_base,
                floor,
                {joint: spring.stiffness for joint, spring in self._springs.items()},
            )
        )
        self._data = self._mujoco.MjData(self._model)
        self._clock, self._steps = 0.0, 0
        wanted = self._wanted = joint_targets(robot.tree, pose.q)
        for joint, target in wanted.items():
            name = self._joint(joint)
            self._data.joint(name).qpos[0] = self._data.actuator(name).ctrl[0] = target
            if joint in self._springs:
                self._data.actuator(name).ctrl[0] -= self._springs[joint].wound
        for _ in range(TRIMS):
            self.advance(TRIMMING * self._settle / TRIMS)
            for joint, target in wanted.items():
                name = self._joint(joint)
                if joint not in self._springs:
                    self._data.actuator(name).ctrl[0] += target - self._data.joint(name).qpos[0]
        self.advance(self._settle - self._clock + (SPRING_SETTLE if self._springs else 0.0))
        check_standing(pose, T_world_base, self._link_frame(0))

    def advance(self, duration: float) -> None:
        """Let *duration* seconds pass; steps are made when they are due, so any length will do."""
        self._require_pose()
        self._clock += duration
        due = int(np.floor(self._clock / TIME_STEP + 1e-6))
        while due > self._steps:
            # Forces on links follow the links; where there are none, all steps are one call.
            steps = min(LOADED_STEPS, due - self._steps) if self._loads else due - self._steps
            self._apply_loads()
            self._mujoco.mj_step(self._model, self._data, steps)
            self._steps += steps
        # a step ends with new positions; forces and frames have to catch up with them
        self._mujoco.mj_forward(self._model, self._data)

    def stand(self, robot: Robot) -> None:
        """Let another robot with the same joints stand there from the next pose on."""
        self._robot = robot

    def pull(self, loads: Sequence[Load]) -> None:
        """Let these forces act from the next pose on."""
        self._loads = tuple(loads)

    @property
    def stiffest_spring(self) -> float:
        """Stiffness of the servos, in whose place springs come [N m/rad]."""
        return SERVO_STIFFNESS * self._robot.tree.total_mass

    def soften(self, springs: Mapping[str, Spring]) -> None:
        """Put springs behind these joints from the next pose on."""
        self._springs = dict(springs)

    def command(self, q: Array) -> None:
        """Move the servos' targets there, with what they make up for sag kept.

        Parameters
        ----------
        q : array, shape (n_joints,)
            [rad] or [m]
        """
        self._require_pose()
        wanted = joint_targets(self._robot.tree, q)
        for joint, target in wanted.items():
            self._data.actuator(self._joint(joint)).ctrl[0] += target - self._wanted[joint]
        self._wanted = wanted

    def state(self) -> WorldState:
        """Return what is true now; ``t`` counts from the moment the pose was placed.

        Raises
        ------
        UsageError
            If no pose was placed yet, or the world is closed.
        """
        self._require_pose()
        robot, data = self._robot, self._data
        tree = robot.tree
        torques = {
            joint.name: float(data.joint(self._joint(joint.name)).qfrc_actuator[0])
            for joint in tree.joints
            if joint.is_movable
        }
        imu = None
        if robot.imu_link is not None:
            imu = specific_force(robot, self._link_frame(tree.link_index[robot.imu_link])[:3, :3])
        return WorldState(
            t=self._clock,
            q=np.array([data.joint(self._joint(n)).qpos[0] for n in tree.joint_names]),
            wrenches={sensor: self._wrench(sensor) for sensor in robot.sensors},
            torques=generalised_torques(tree, torques),
            imu=imu,
            com=np.array(data.body(link_name(0)).subtree_com),
            T_world_base=self._link_frame(0),
            encoders=self._encoders() if self._springs else None,
        )

    def close(self) -> None:
        """Release the engine; closing twice is harmless."""
        self._model = self._data = None
        self._closed = True

    def __enter__(self) -> MujocoWorld:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _require_pose(self) -> None:
        if self._data is None:
            raise UsageError(
                "there is no state",
                where=self.name,
                next_step="open a new world" if self._closed else "place the robot in a pose first",
            )

    def _encoders(self) -> Array:
        """Return where the motors are: behind the springs, elsewhere at the joints."""
        data = self._data
        return np.array(
            [
                data.actuator(self._joint(n)).ctrl[0]
                if n in self._springs
                else data.joint(self._joint(n)).qpos[0]
                for n in self._robot.tree.joint_names
            ]
        )

    def _apply_loads(self) -> None:
        if not self._loads:
            return
        self._data.xfrc_applied[:] = 0.0
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)
        for load in self._loads:
            T = self._link_frame(load.link)
            point = T[:3, :3] @ load.point + T[:3, 3]
            force = load.at(point)
            body = self._data.body(link_name(load.link))
            # MuJoCo applies it at the CoM of the body
            moment = np.cross(point - np.array(body.xipos), force)
            self._data.xfrc_applied[body.id] += np.concatenate([force, moment])

    def _joint(self, name: str) -> str:
        return joint_name(self._robot.tree.joint_index[name])

    def _link_frame(self, k: int) -> Array:
        body = self._data.body(link_name(k))
        return transform_from(np.reshape(body.xmat, (3, 3)), body.xpos)

    def _wrench(self, sensor: str) -> Array:
        # MuJoCo: parent on child, in and about the frame of the site on the child
        force = self._data.sensor(force_name(self._robot, sensor)).data
        torque = self._data.sensor(torque_name(self._robot, sensor)).data
        return on_part_above(self._robot, sensor, np.concatenate([force, torque]))
