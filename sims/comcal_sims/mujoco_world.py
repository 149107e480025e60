# SPDX-License-Identifier: Apache-2.0
"""The robot standing in MuJoCo, an engine with springy contacts and servos of finite stiffness."""

from __future__ import annotations

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
from comcal_sims.mujoco_xml import TIME_STEP, force_name, mujoco_xml, torque_name
from comcal_sims.rotations import floor_rotation
from comcal_sims.world import WorldState

TRIMS = 4
"""How often the servos make up for their sag while a pose settles."""
TRIMMING = 0.6
"""Share of the settling time in which they do; the rest is for coming to rest."""


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
        self._model = self._mujoco.MjModel.from_xml_string(mujoco_xml(robot, T_world_base, floor))
        self._data = self._mujoco.MjData(self._model)
        self._clock, self._steps = 0.0, 0
        wanted = joint_targets(robot.tree, pose.q)
        for joint, target in wanted.items():
            name = self._joint(joint)
            self._data.joint(name).qpos[0] = self._data.actuator(name).ctrl[0] = target
        for _ in range(TRIMS):
            self.advance(TRIMMING * self._settle / TRIMS)
            for joint, target in wanted.items():
                name = self._joint(joint)
                self._data.actuator(name).ctrl[0] += target - self._data.joint(name).qpos[0]
        self.advance(self._settle - self._clock)
        check_standing(pose, T_world_base, self._link_frame(0))

    def advance(self, duration: float) -> None:
        """Let *duration* seconds pass; steps are made when they are due, so any length will do."""
        self._require_pose()
        self._clock += duration
        due = int(np.floor(self._clock / TIME_STEP + 1e-6))
        if due > self._steps:
            self._mujoco.mj_step(self._model, self._data, due - self._steps)
            self._steps = due
        # a step ends with new positions; forces and frames have to catch up with them
        self._mujoco.mj_forward(self._model, self._data)

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
