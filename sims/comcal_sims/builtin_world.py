# SPDX-License-Identifier: Apache-2.0
"""A world without an engine: the robot is rigid, at rest, and in exactly the wanted pose.

Every load (weights, floor, the hand that holds a hanging robot) is a wrench on one link about the
world's origin. A cut through the tree then carries the sum of the loads on one of its sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comcal.errors import NotBalancedError, UsageError
from comcal.measure.plan import NONE, PlannedPose
from comcal.robot.frames import apply, skew
from comcal.robot.kinematics import place_links
from comcal.robot.model import Base, Foot, Robot
from comcal.robot.tree import Array, JointType, Tree
from comcal_sims.contact import corner_forces
from comcal_sims.footing import base_in_world, standing_feet
from comcal_sims.robots.balance import support_margin
from comcal_sims.rotations import floor_rotation
from comcal_sims.springless import Springless
from comcal_sims.world import Load, WorldState


class BuiltinWorld(Springless):
    """Plain statics behind the :class:`~comcal_sims.world.World` port.

    Parameters
    ----------
    robot : Robot
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._loads: tuple[Load, ...] = ()
        self._pose: PlannedPose | None = None
        self._state: WorldState | None = None

    @property
    def name(self) -> str:
        """Name for the session file."""
        return "builtin statics"

    def place(self, pose: PlannedPose) -> None:
        """Put the robot into *pose*; there is nothing to settle.

        Raises
        ------
        UsageError
            If the standing soles do not lie in one plane, or there is no such support.
        NotBalancedError
            If the robot would fall over.
        """
        t = self._state.t if self._state is not None else 0.0
        self._state = replace(static_state(self._robot, pose, self._loads), t=t)
        self._pose = pose

    def stand(self, robot: Robot) -> None:
        """Let another robot with the same joints stand there from the next pose on."""
        self._robot = robot

    def pull(self, loads: Sequence[Load]) -> None:
        """Let these forces act from the next pose on."""
        self._loads = tuple(loads)

    def command(self, q: Array) -> None:
        """Put the joints there at once.

        Parameters
        ----------
        q : array, shape (n_joints,)
            [rad] or [m]
        """
        if self._pose is None:
            raise _empty(self.name)
        self.place(replace(self._pose, q=q))

    def advance(self, duration: float) -> None:
        """Let *duration* seconds pass, in which nothing happens."""
        state = self.state()
        self._state = replace(state, t=state.t + duration)

    def state(self) -> WorldState:
        """Return what is true now.

        Raises
        ------
        UsageError
            If no pose was placed yet.
        """
        if self._state is None:
            raise _empty(self.name)
        return self._state

    def close(self) -> None:
        """Forget the pose."""
        self._state = self._pose = None


def _empty(name: str) -> UsageError:
    return UsageError("the world is empty", where=name, next_step="place a pose first")


def static_state(robot: Robot, pose: PlannedPose, pulls: Sequence[Load] = ()) -> WorldState:
    """Return every wrench and torque of a robot at rest.

    Parameters
    ----------
    robot : Robot
    pose : PlannedPose
        Standing feet are put flat on the floor ``R_world_P = Ry(pitch) Rx(roll)`` through the
        world's origin; with support ``none``, or a fixed base, the root link is held level.
    pulls : sequence of Load
        Forces besides weight and floor.

    Returns
    -------
    WorldState
        At time zero. The split of two feet follows :func:`~comcal_sims.contact.corner_forces`.

    Raises
    ------
    UsageError
        If the standing soles do not lie in one plane, or there is no such support.
    NotBalancedError
        If the CoM is not above the support polygon.
    """
    if robot.base is Base.FIXED:
        pose = replace(pose, support=NONE)
    tree = robot.tree
    T = base_in_world(robot, pose)
    placements = place_links(tree, pose.q)
    R = T[:3, :3] @ placements.R[0]
    p = placements.p[0] @ T[:3, :3].T + T[:3, 3]
    coms = p + apply(R, tree.coms)
    weights = np.zeros((len(tree.links), 3))
    weights[:, 2] = -robot.gravity * tree.masses
    loads = _wrenches_of(coms, weights)
    for pull in pulls:
        point = p[pull.link] + R[pull.link] @ pull.point
        loads[pull.link] += _wrenches_of(point[None], pull.at(point)[None])[0]
    com = tree.masses @ coms / tree.total_mass
    feet = standing_feet(robot, pose.support)
    if feet:
        normal = floor_rotation(pose.floor_roll, pose.floor_pitch)[:, 2]
        carried = loads.sum(axis=0)
        loads += _floor_on_links(tree, feet, R, p, normal, carried)
        _check_balance(tree, feet, R, p, _on_floor(carried, normal) if pulls else com, pose)
    else:
        loads[0] -= loads.sum(axis=0)
    return WorldState(
        t=0.0,
        q=np.array(pose.q, dtype=np.float64),
        wrenches=_sensor_wrenches(robot, loads, R, p),
        torques=_joint_torques(tree, loads, R, p),
        imu=_specific_force(robot, R),
        com=com,
        T_world_base=T,
    )


def _corners(tree: Tree, foot: Foot, R: Array, p: Array) -> Array:
    """Return the corners of a sole in the world, shape (n, 3)."""
    k = tree.link_index[foot.link]
    sole = np.zeros((0, 2)) if foot.sole is None else foot.sole
    in_sole = np.column_stack([sole, np.zeros(len(sole))])
    in_link = in_sole @ foot.T_link_sole[:3, :3].T + foot.T_link_sole[:3, 3]
    return in_link @ R[k].T + p[k]


def _floor_on_links(
    tree: Tree, feet: tuple[Foot, ...], R: Array, p: Array, normal: Array, weight: Array
) -> Array:
    corners = [_corners(tree, foot, R, p) for foot in feet]
    points = np.vstack(corners)
    forces = corner_forces(points, normal, -weight[:3], -weight[3:])
    wrenches = _wrenches_of(points, forces)
    loads = np.zeros((len(tree.links), 6))
    ends = np.cumsum([len(points) for points in corners])
    for foot, part in zip(feet, np.split(wrenches, ends[:-1]), strict=True):
        loads[tree.link_index[foot.link]] += part.sum(axis=0)
    return loads


def _on_floor(carried: Array, normal: Array) -> Array:
    """Return where the resultant of all loads pierces the floor through the origin, shape (3,)."""
    force, moment = carried[:3], carried[3:]
    return np.cross(normal, moment) / (force @ normal)


def _check_balance(
    tree: Tree, feet: tuple[Foot, ...], R: Array, p: Array, com: Array, pose: PlannedPose
) -> None:
    # Gravity is along the world's z: the plan view decides, whatever the slope.
    points = np.vstack([_corners(tree, foot, R, p) for foot in feet])
    margin = support_margin(com[:2], points[:, :2])
    if margin < 0.0:
        raise NotBalancedError(
            "the robot would fall over",
            where=f"pose {pose.pose}",
            measured=f"CoM {-margin * 1e3:.1f} mm outside the soles that stand ({pose.support})",
            limit="0 mm",
            next_step="move the CoM above the soles or drop the pose",
        )


def _wrenches_of(points: Array, forces: Array) -> Array:
    """Return forces at points as wrenches about the world's origin, shape (n, 6)."""
    return np.concatenate([forces, apply(skew(points), forces)], axis=-1)


def _moved(wrench: Array, origin: Array) -> Array:
    """Return a wrench about the world's origin as one about *origin*."""
    return np.concatenate([wrench[:3], wrench[3:] - np.cross(origin, wrench[:3])])


def _sensor_wrenches(robot: Robot, loads: Array, R: Array, p: Array) -> dict[str, Array]:
    wrenches = dict[str, Array]()
    for sensor in robot.sensors.values():
        k = robot.tree.joint_index[sensor.joint] + 1
        # What lies below the cut passes on to the part above it all that it is loaded with.
        wrench = _moved(loads[robot.below_cut[sensor.name]].sum(axis=0), p[k])
        wrenches[sensor.name] = (wrench.reshape(2, 3) @ R[k]).ravel()
    return wrenches


def _joint_torques(tree: Tree, loads: Array, R: Array, p: Array) -> Array:
    column = {name: i for i, name in enumerate(tree.joint_names)}
    beyond = tree.descendants @ loads
    torques = np.zeros(len(column))
    for k, joint in enumerate(tree.joints, start=1):
        if not joint.is_movable:
            continue
        on_child = -_moved(beyond[k], p[k])
        part = on_child[:3] if joint.kind is JointType.PRISMATIC else on_child[3:]
        torque = float(R[k] @ joint.axis @ part)
        if joint.mimic is None:
            torques[column[joint.name]] += torque
        else:
            torques[column[joint.mimic.joint]] += joint.mimic.multiplier * torque
    return torques


def _specific_force(robot: Robot, R: Array) -> Array | None:
    if robot.imu_link is None:
        return None
    return R[robot.tree.link_index[robot.imu_link]][2] * robot.gravity
