# SPDX-License-Identifier: Apache-2.0
"""The robot as it really is: bodies, lengths and sensor frames of the tree, changed.

Whatever simulates the changed robot then has the effect in its physics: a payload is a body on a
fixed joint, a turned sensor sits on a joint of its own that is really turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comcal.errors import UsageError
from comcal.robot.changes import Change
from comcal.robot.frames import rotation_about, transform_from
from comcal.robot.model import Robot
from comcal.robot.tree import Array, Joint, JointType, Link, Tree
from comcal_sims.rotations import floor_rotation

_PAYLOAD_RADIUS = 0.05
"""Of the ball that a payload is [m]; statics do not see it."""
_NO_INERTIA = np.zeros((3, 3))
_COM = ("com_x", "com_y", "com_z")
_XYZ = ("x", "y", "z")


def built_robot(robot: Robot, changes: Sequence[Change]) -> Robot:
    """Return the robot that *changes* describe, as far as bodies and frames go.

    Parameters
    ----------
    robot : Robot
        As designed.
    changes : sequence of Change
        Others than those of bodies, lengths and mountings are left alone here.

    Returns
    -------
    Robot
        The same joints in the same order of ``joint_names``; more links and fixed joints.

    Raises
    ------
    UsageError
        If a mass would not be positive.
    """
    for change in changes:
        if change.effect == "link_mass":
            robot = _heavier(robot, robot.tree.link_index[change.target], change)
        elif change.effect == "sole_mass":
            below = np.where(robot.below_cut[change.target], robot.tree.masses, -np.inf)
            robot = _heavier(robot, int(np.argmax(below)), change)
        elif change.effect == "link_com":
            k = robot.tree.link_index[change.target]
            com = robot.tree.links[k].com + change.numbers(*_COM)
            robot = _with_link(robot, k, replace(robot.tree.links[k], com=com))
        elif change.effect == "link_length":
            robot = _lengthened(robot, change)
    # New links come last: the changes above find the heaviest one among those of the design.
    for change in changes:
        if change.effect == "payload":
            robot = _loaded(robot, change)
    for sensor in robot.sensors:
        robot = _remounted(robot, sensor, changes)
    return _imu_remounted(robot, changes)


def _heavier(robot: Robot, k: int, change: Change) -> Robot:
    link = robot.tree.links[k]
    mass = link.mass + change.number("mass")
    if not mass > 0.0:
        raise UsageError(
            f"link {link.name} would have no mass left",
            where=f"{change.effect}@{change.target}",
            measured=f"{link.mass:g} kg {change.number('mass'):+g} kg",
            limit="above 0 kg",
            next_step="take a smaller change",
        )
    return _with_link(robot, k, replace(link, mass=mass))


def _with_link(robot: Robot, k: int, link: Link) -> Robot:
    links = list(robot.tree.links)
    links[k] = link
    return replace(robot, tree=replace(robot.tree, links=tuple(links)))


def _lengthened(robot: Robot, change: Change) -> Robot:
    joints = list(robot.tree.joints)
    k = robot.tree.joint_index[change.target]
    T = joints[k].T_parent_joint.copy()
    T[:3, 3] += change.numbers(*_XYZ)
    joints[k] = replace(joints[k], T_parent_joint=T)
    return replace(robot, tree=replace(robot.tree, joints=tuple(joints)))


def _loaded(robot: Robot, change: Change) -> Robot:
    tree, mass = robot.tree, change.number("mass")
    inertia = 0.4 * mass * _PAYLOAD_RADIUS**2 * np.eye(3)
    name = f"payload {len(tree.links)}"
    load = Link(name, mass, np.array(change.numbers(*_COM)), inertia)
    strap = Joint(name, JointType.FIXED, change.target, name, np.eye(4), np.zeros(3))
    changed = replace(tree, links=(*tree.links, load), joints=(*tree.joints, strap))
    return replace(robot, tree=changed)


def _remounted(robot: Robot, sensor: str, changes: Sequence[Change]) -> Robot:
    """Give a sensor a fixed joint of its own, turned and moved against its nominal frame.

    The contract is w' = R(rotvec) w about the displaced origin, so the sensor's axes are those of
    R(-rotvec) in the nominal frame.
    """
    R, p = np.eye(3), np.zeros(3)
    for change in changes:
        if change.target != sensor:
            continue
        if change.effect == "ft_mounting":
            R = R @ rotation_of(-np.array(change.numbers("rx", "ry", "rz")))
        elif change.effect == "ft_position":
            p = p + change.numbers(*_XYZ)
    if not p.any() and np.array_equal(R, np.eye(3)):
        return robot
    T = transform_from(R, p)
    where = robot.sensors[sensor].joint
    tree = _with_cut(robot.tree, where, T)
    moved = replace(robot.sensors[sensor], joint=_cut(where), below=None)
    return replace(robot, tree=tree, sensors={**robot.sensors, sensor: moved})


def _cut(joint: str) -> str:
    return f"{joint} sensor"


def _with_cut(tree: Tree, name: str, T_joint_sensor: Array) -> Tree:
    """Put two massless links beyond a joint, with a fixed joint between them for the sensor."""
    links, joints = [tree.links[0]], list[Joint]()
    for joint, link in zip(tree.joints, tree.links[1:], strict=True):
        if joint.name != name:
            joints.append(joint)
            links.append(link)
            continue
        before, after = f"{name} flange", f"{name} shell"
        back = _inverse(T_joint_sensor)
        joints += [
            replace(joint, child=before),
            _fixed(_cut(name), before, after, T_joint_sensor),
            _fixed(f"{name} back", after, joint.child, back),
        ]
        links += [_massless(before), _massless(after), link]
    return replace(tree, links=tuple(links), joints=tuple(joints))


def _imu_remounted(robot: Robot, changes: Sequence[Change]) -> Robot:
    roll, pitch = np.sum(
        [c.numbers("roll", "pitch") for c in changes if c.effect == "imu_mounting"] or [[0.0, 0.0]],
        axis=0,
    ).tolist()
    if robot.imu_link is None or (roll == 0.0 and pitch == 0.0):
        return robot
    name = f"{robot.imu_link} imu"
    T = transform_from(floor_rotation(roll, pitch), np.zeros(3))
    tree = replace(
        robot.tree,
        links=(*robot.tree.links, _massless(name)),
        joints=(*robot.tree.joints, _fixed(name, robot.imu_link, name, T)),
    )
    return replace(robot, tree=tree, imu_link=name)


def _fixed(name: str, parent: str, child: str, T: Array) -> Joint:
    return Joint(name, JointType.FIXED, parent, child, T, np.zeros(3))


def _massless(name: str) -> Link:
    return Link(name, 0.0, np.zeros(3), _NO_INERTIA, has_inertial=False)


def _inverse(T: Array) -> Array:
    R = T[:3, :3].T
    return transform_from(R, -R @ T[:3, 3])


def rotation_of(rotvec: Array) -> Array:
    """Return the rotation by a rotation vector, shape (3,) [rad]."""
    angle = float(np.linalg.norm(rotvec))
    return np.eye(3) if angle == 0.0 else rotation_about(rotvec / angle, angle)
