# SPDX-License-Identifier: Apache-2.0
"""The robot inside one pybullet client: loading, posing, commanding and reading it.

All of pybullet's numbering and sign conventions end here.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from comcal.robot.frames import transform_from
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal_sims.conventions import (
    generalised_torques,
    joint_name,
    joint_targets,
    link_name,
    on_part_above,
)
from comcal_sims.pybullet_urdf import cut_name
from comcal_sims.rotations import quaternion_xyzw
from comcal_sims.world import Load

FRICTION = 1.0
POSITION_GAIN = 0.3
VELOCITY_GAIN = 1.0
STRONG = 10.0
"""Torque limit of a motor without one of its own, in weights of the robot times 1 m."""
_BASE = -1


class BulletBody:
    """The robot in one client.

    Parameters
    ----------
    engine : module
        pybullet.
    client : int
    robot : Robot
    urdf : str
        What :func:`comcal_sims.pybullet_urdf.bullet_urdf` makes of it.
    held : bool
        Whether the base link is nailed to the world.
    """

    def __init__(
        self, engine: ModuleType, client: int, robot: Robot, urdf: str, *, held: bool
    ) -> None:
        self._p, self._client, self._robot = engine, client, robot
        with tempfile.TemporaryDirectory(prefix="comcal-") as directory:
            path = Path(directory) / "robot.urdf"
            path.write_text(urdf, encoding="utf-8")
            self.id: int = engine.loadURDF(
                str(path),
                useFixedBase=held,
                # without it, links that touch nothing would get no inertia
                flags=engine.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=client,
            )
        self._number_links()
        self._masses = np.array(
            [
                engine.getDynamicsInfo(self.id, link, physicsClientId=client)[0]
                for link in self._links
            ]
        )
        if held:  # pybullet says that a base nailed to the world weighs nothing
            self._masses[0] = robot.tree.masses[0]
        for link in self._links:
            self._change(link, lateralFriction=FRICTION)
            self._change(link, activationState=engine.ACTIVATION_STATE_DISABLE_SLEEPING)
        for joint in self._cuts.values():
            engine.enableJointForceTorqueSensor(self.id, joint, True, physicsClientId=client)

    def _number_links(self) -> None:
        """Find pybullet's numbers of links, joints and cuts."""
        p, tree = self._p, self._robot.tree
        joints: dict[str, int] = {}
        links: dict[str, int] = {link_name(0): _BASE}
        for i in range(p.getNumJoints(self.id, physicsClientId=self._client)):
            info = p.getJointInfo(self.id, i, physicsClientId=self._client)
            joints[info[1].decode()] = links[info[12].decode()] = i
        self._links = [links[link_name(k)] for k in range(len(tree.links))]
        """By link of the tree."""
        self._joints = {j.name: joints[joint_name(k)] for k, j in enumerate(tree.joints)}
        """By name of the joint in the tree."""
        self._cuts: dict[str, int] = {}
        """By sensor: the fixed joint whose load pybullet reports."""
        for sensor in self._robot.sensors.values():
            k = tree.joint_index[sensor.joint]
            self._cuts[sensor.name] = joints.get(cut_name(k), joints[joint_name(k)])

    def soften(self, stiffness: float, damping: float) -> None:
        """Put a spring [N/m] and a damper [N s/m] under each corner of every sole."""
        for foot in self._robot.feet.values():
            link = self._links[self._robot.tree.link_index[foot.link]]
            self._change(link, contactStiffness=stiffness, contactDamping=damping)

    def put(self, T_world_base: Array, q: Array) -> None:
        """Move the root link and the joints there at once, and command the motors to hold.

        Parameters
        ----------
        T_world_base : array, shape (4, 4)
        q : array, shape (n_joints,)
            In the order of ``tree.joint_names`` [rad] or [m].
        """
        p, client = self._p, self._client
        info = p.getDynamicsInfo(self.id, _BASE, physicsClientId=client)
        # pybullet places the inertial frame of the base, not its link frame
        position, orientation = p.multiplyTransforms(
            T_world_base[:3, 3].tolist(),
            quaternion_xyzw(T_world_base[:3, :3]).tolist(),
            info[3],
            info[4],
        )
        p.resetBasePositionAndOrientation(self.id, position, orientation, physicsClientId=client)
        for name, target in joint_targets(self._robot.tree, q).items():
            p.resetJointState(self.id, self._joints[name], target, 0.0, physicsClientId=client)
        self.command(q)

    def command(self, q: Array) -> None:
        """Let the motors move the joints there.

        Parameters
        ----------
        q : array, shape (n_joints,)
            In the order of ``tree.joint_names`` [rad] or [m].
        """
        p, client = self._p, self._client
        strong = STRONG * self._robot.tree.total_mass * self._robot.gravity
        targets = joint_targets(self._robot.tree, q)
        for joint in self._robot.tree.joints:
            if not joint.is_movable:
                continue
            number, target = self._joints[joint.name], targets[joint.name]
            p.setJointMotorControl2(
                self.id,
                number,
                p.POSITION_CONTROL,
                targetPosition=target,
                positionGain=POSITION_GAIN,
                velocityGain=VELOCITY_GAIN,
                force=joint.effort if 0.0 < joint.effort < np.inf else strong,
                physicsClientId=client,
            )

    def joint_state(self) -> tuple[Array, Array]:
        """Return positions [rad] or [m] and torques on the child about +axis, (n_joints,) each."""
        tree = self._robot.tree
        states = {
            joint.name: self._joint_state(self._joints[joint.name])
            for joint in tree.joints
            if joint.is_movable
        }
        torques = {name: state[3] for name, state in states.items()}
        return (
            np.array([states[name][0] for name in tree.joint_names]),
            generalised_torques(tree, torques),
        )

    def pull(self, load: Load) -> None:
        """Let a force act during the next step; pybullet forgets it then."""
        T = self.link_frame(load.link)
        point = T[:3, :3] @ load.point + T[:3, 3]
        self._p.applyExternalForce(
            self.id,
            self._links[load.link],
            load.at(point).tolist(),
            point.tolist(),
            self._p.WORLD_FRAME,
            physicsClientId=self._client,
        )

    def link_frame(self, k: int) -> Array:
        """Return the pose of the link frame of link *k* in the world, shape (4, 4)."""
        p, number = self._p, self._links[k]
        if number == _BASE:
            info = p.getDynamicsInfo(self.id, _BASE, physicsClientId=self._client)
            position, orientation = p.multiplyTransforms(
                *self._base_state(),
                *p.invertTransform(info[3], info[4]),
            )
        else:
            position, orientation = self._link_state(number)[4:6]
        return transform_from(self._rotation(orientation), position)

    def com(self) -> Array:
        """Return the CoM of the whole robot in the world, shape (3,) [m]."""
        at = [
            self._base_state()[0] if number == _BASE else self._link_state(number)[0]
            for number in self._links
        ]
        return self._masses @ np.array(at) / self._masses.sum()

    def wrench(self, sensor: str) -> Array:
        """Return the wrench of the part below a sensor's cut on the part above it, shape (6,).

        In and about the frame of the sensor's joint, child side [N, N m].
        """
        number = self._cuts[sensor]
        # parent on child, about the joint, but in the axes of the world
        reading = np.reshape(self._joint_state(number)[2], (2, 3))
        R_world_sensor = self._rotation(self._link_state(number)[5])
        return on_part_above(self._robot, sensor, (reading @ R_world_sensor).ravel())

    def _change(self, link: int, **properties: float) -> None:
        self._p.changeDynamics(self.id, link, physicsClientId=self._client, **properties)

    def _base_state(self) -> Sequence[Sequence[float]]:
        """Return position and orientation of the inertial frame of the base."""
        return self._p.getBasePositionAndOrientation(self.id, physicsClientId=self._client)

    def _joint_state(self, number: int) -> Any:
        return self._p.getJointState(self.id, number, physicsClientId=self._client)

    def _link_state(self, number: int) -> Sequence[Sequence[float]]:
        return self._p.getLinkState(
            self.id, number, computeForwardKinematics=True, physicsClientId=self._client
        )

    def _rotation(self, orientation: Sequence[float]) -> Array:
        return np.reshape(self._p.getMatrixFromQuaternion(orientation), (3, 3))
