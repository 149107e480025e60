# SPDX-License-Identifier: Apache-2.0
"""The MJCF text that MuJoCo compiles: robot, floor, servos and sensors.

It is written from the tree rather than imported from the robot's URDF: fixed joints stay cuts that
a sensor can sit in, and links without mass or with unphysical inertia do not stop the compiler.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as ET

import numpy as np

from comcal.robot.model import Robot
from comcal.robot.tree import Array, Joint, JointType, Link
from comcal_sims.conventions import joint_name, link_name
from comcal_sims.footing import BUMPER_RADIUS, bumper_centres
from comcal_sims.rotations import quaternion_wxyz

TIME_STEP = 1e-3
"""[s]"""
CONTACT = "-30000 -1000"
"""Stiffness [1/s^2] and damping [1/s] of a contact, MuJoCo's direct ``solref``."""
IMPEDANCE = "0.95 0.95 0.001"
"""The same for any penetration (``solimp``)."""
GRIP = 100.0
"""How much stiffer friction is than the normal contact (``impratio``). It keeps feet from creeping
without the ``noslip`` pass, which changes friction behind the solver's back: with it, corners that
hardly carry hop for ever and the wrenches are off by up to 0.5 N."""
TOLERANCE = 1e-15
"""Of the solver. Stopped at the default of 1e-8 it makes such corners hop, too."""
FRICTION = "1 0.005 0.0001"

SERVO_STIFFNESS = 2e4 / 18.6
"""Per kilogram of robot [N m/rad/kg]."""
SERVO_DAMPING = 0.05
"""Velocity gain over position gain [s]."""
ROTOR_INERTIA = 1.0 / 18.6
"""Behind the gear, per kilogram of robot [m^2]. Without it, light links between stiff servos and
the ground chatter: the integrator and the contact solver see different dampings. At rest it has no
effect."""
SWINGING_INERTIA = 0.5
"""Of a robot about one of its joints, per kilogram [m^2], for the damping of springs."""

_LEAST_MASS = 1e-9
_LEAST_INERTIA = 1e-6


def mujoco_xml(
    robot: Robot,
    T_world_base: Array,
    R_world_floor: Array | None,
    springs: Mapping[str, float] | None = None,
) -> str:
    """Return the text of the MuJoCo model.

    Parameters
    ----------
    robot : Robot
        Soles become balls under their corners; no other link touches anything.
    T_world_base : array, shape (4, 4)
        Where the root link starts, or stays if there is no floor.
    R_world_floor : array, shape (3, 3), or None
        Floor through the world's origin; None: the root link is nailed to the world.
    springs : mapping from joint name to float
        Stiffness of joints that are softer than their servos [N m/rad].

    Notes
    -----
    A box on a plane would do as well here (4 contacts, the same wrenches to 1e-3 N), but only for
    rectangular soles; balls serve any sole and touch where the corners in robot.yaml are.
    """
    root = ET.Element("mujoco")
    # statics do not depend on the inertia tensor, so an unphysical one need not stop the compiler
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false", balanceinertia="true")
    ET.SubElement(
        root,
        "option",
        timestep=repr(TIME_STEP),
        integrator="implicitfast",
        cone="elliptic",
        impratio=repr(GRIP),
        tolerance=repr(TOLERANCE),
        gravity=_text((0.0, 0.0, -robot.gravity)),
    )
    world = ET.SubElement(root, "worldbody")
    if R_world_floor is not None:
        floor = {"type": "plane", "size": "0 0 1", "quat": _text(quaternion_wxyz(R_world_floor))}
        _add_geom(world, floor, touches="1", touched_by="0")
    actuators, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    bodies = list[ET.Element]()
    for k, link in enumerate(robot.tree.links):
        if k == 0:
            body = _add_body(world, 0, T_world_base)
            if R_world_floor is not None:
                ET.SubElement(body, "freejoint")
        else:
            joint = robot.tree.joints[k - 1]
            body = _add_body(bodies[robot.tree.parents[k]], k, joint.T_parent_joint)
            if joint.is_movable:
                stiffness = (springs or {}).get(joint.name)
                mass = robot.tree.total_mass
                _add_servo(body, actuators, joint_name(k - 1), joint, mass, stiffness)
            _add_sensors(body, sensors, robot, joint)
        bodies.append(body)
        _add_inertial(body, link)
        for foot in robot.feet.values():
            for centre in bumper_centres(foot) if foot.link == link.name else ():
                ball = {"type": "sphere", "size": repr(BUMPER_RADIUS), "pos": _text(centre)}
                _add_geom(body, ball, touches="0", touched_by="1")
    return ET.tostring(root, encoding="unicode")


def force_name(robot: Robot, sensor: str) -> str:
    """Return the name of the force reading of *sensor* inside the model."""
    return f"force{_number(robot, sensor)}"


def torque_name(robot: Robot, sensor: str) -> str:
    """Return the name of the torque reading of *sensor* inside the model."""
    return f"torque{_number(robot, sensor)}"


def _number(robot: Robot, sensor: str) -> int:
    return list(robot.sensors).index(sensor)


def _add_body(parent: ET.Element, k: int, T: Array) -> ET.Element:
    return ET.SubElement(
        parent,
        "body",
        name=link_name(k),
        pos=_text(T[:3, 3]),
        quat=_text(quaternion_wxyz(T[:3, :3])),
    )


def _add_inertial(body: ET.Element, link: Link) -> None:
    inertia = link.inertia if np.trace(link.inertia) > 0.0 else _LEAST_INERTIA * np.eye(3)
    entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    ET.SubElement(
        body,
        "inertial",
        pos=_text(link.com),
        mass=repr(max(float(link.mass), _LEAST_MASS)),
        fullinertia=_text(entries),
    )


def _add_servo(
    body: ET.Element,
    actuators: ET.Element,
    name: str,
    joint: Joint,
    mass: float,
    spring: float | None,
) -> None:
    ET.SubElement(
        body,
        "joint",
        name=name,
        type="slide" if joint.kind is JointType.PRISMATIC else "hinge",
        axis=_text(joint.axis),
        armature=repr(ROTOR_INERTIA * mass),
    )
    stiffness = SERVO_STIFFNESS * mass if spring is None else spring
    damping = SERVO_DAMPING * stiffness
    if spring is not None:  # so that the whole robot on this spring comes to rest without swinging
        damping = 2.0 * np.sqrt(stiffness * SWINGING_INERTIA * mass)
    servo = ET.SubElement(
        actuators,
        "position",
        name=name,
        joint=name,
        kp=repr(stiffness),
        kv=repr(float(damping)),
    )
    if 0.0 < joint.effort < np.inf:
        servo.set("forcelimited", "true")
        servo.set("forcerange", _text((-joint.effort, joint.effort)))


def _add_sensors(body: ET.Element, sensors: ET.Element, robot: Robot, joint: Joint) -> None:
    for sensor in robot.sensors.values():
        if sensor.joint == joint.name:
            site = f"site{_number(robot, sensor.name)}"
            ET.SubElement(body, "site", name=site)
            ET.SubElement(sensors, "force", name=force_name(robot, sensor.name), site=site)
            ET.SubElement(sensors, "torque", name=torque_name(robot, sensor.name), site=site)


def _add_geom(body: ET.Element, shape: dict[str, str], *, touches: str, touched_by: str) -> None:
    ET.SubElement(
        body,
        "geom",
        shape,
        solref=CONTACT,
        solimp=IMPEDANCE,
        friction=FRICTION,
        contype=touches,
        conaffinity=touched_by,
    )


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)
