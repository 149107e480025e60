# SPDX-License-Identifier: Apache-2.0
"""What a demo hides: one fault that an engineer may well meet, large enough to be seen.

Only what the poses of a demo can decide is drawn. A shoulder whose encoder is off, say, looks like
an arm whose CoM is elsewhere, whatever the poses: that would make a riddle, not a demo.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from comcal.robot.changes import Change
from comcal.robot.model import Robot

HEAVY = 0.05
"""Share of the robot's mass that a link must have for something to be strapped to it."""
AWAY = 0.12
"""Distance of what is strapped to a link from the CoM of that link, at least [m]."""
LEAST_LEG = 5
"""Joints of a leg that can put its foot flat on a floor of any slope, whatever its heading."""
DIGITS = 2
"""To which values are rounded, so that truth and answer are easily compared."""

Draw = Callable[[Robot, np.random.Generator], Change]


def draw_fault(robot: Robot, rng: np.random.Generator) -> Change:
    """Draw a fault of a robot: its kind, where it sits, and how large it is.

    Parameters
    ----------
    robot : Robot
        With a sensor in a foot at least.
    rng : numpy.random.Generator
    """
    kinds = [kind for kind in KINDS if _is_possible(kind, robot)]
    return KINDS[kinds[rng.integers(len(kinds))]](robot, rng)


def _is_possible(kind: str, robot: Robot) -> bool:
    legs = _leg_joints(robot)
    if kind in ("torque_constant", "current_offset"):
        return any(joint in robot.motors for joint in legs)
    if kind == "sole_compliance":  # planar legs could not follow a sole that gives to the side
        return len(legs) >= LEAST_LEG * len(robot.feet)
    return kind != "imu_mounting" or robot.imu_link is not None


def _payload(robot: Robot, rng: np.random.Generator) -> Change:
    links = [x for x in robot.tree.links if x.mass > HEAVY * robot.tree.total_mass]
    link = links[rng.integers(len(links))]
    mass = _rounded(robot.tree.total_mass * rng.uniform(0.03, 0.06))
    place = link.com
    # At the CoM of its link it would only be a link that is heavier than its CAD says.
    while np.linalg.norm(place - link.com) < AWAY:
        place = 0.5 * link.com + rng.uniform(-AWAY, AWAY, 3)
    com = {f"com_{axis}": _rounded(x) for axis, x in zip("xyz", place, strict=True)}
    return Change("payload", link.name, {"mass": mass, **com})


def _ft_gain(robot: Robot, rng: np.random.Generator) -> Change:
    return Change("ft_gain", _foot_sensor(robot, rng), {"gain_fz": _signed(rng, 0.03, 0.08)})


def _ft_bias(robot: Robot, rng: np.random.Generator) -> Change:
    force, moment = str(rng.choice(["fx", "fy", "fz"])), str(rng.choice(["tx", "ty"]))
    values = {force: _signed(rng, 8.0, 20.0), moment: _signed(rng, 0.8, 2.0)}
    return Change("ft_bias", _foot_sensor(robot, rng), values)


def _ft_mounting(robot: Robot, rng: np.random.Generator) -> Change:
    key = str(rng.choice(["rx", "ry", "rz"]))
    return Change("ft_mounting", _foot_sensor(robot, rng), {key: _signed(rng, 1.5, 4.0, _DEGREE)})


def _joint_offset(robot: Robot, rng: np.random.Generator) -> Change:
    values = {"offset": _signed(rng, 1.0, 2.5, _DEGREE)}
    return Change("joint_offset", str(rng.choice(_leg_joints(robot))), values)


def _joint_compliance(robot: Robot, rng: np.random.Generator) -> Change:
    values = {"stiffness": _rounded(rng.uniform(1000.0, 3000.0))}
    return Change("joint_compliance", str(rng.choice(_leg_joints(robot))), values)


def _torque_constant(robot: Robot, rng: np.random.Generator) -> Change:
    joints = [joint for joint in _leg_joints(robot) if joint in robot.motors]
    return Change("torque_constant", str(rng.choice(joints)), {"relative": _signed(rng, 0.1, 0.25)})


def _ground_tilt(_: Robot, rng: np.random.Generator) -> Change:
    return Change("ground_tilt", "", _angles(rng))


def _imu_mounting(_: Robot, rng: np.random.Generator) -> Change:
    return Change("imu_mounting", "", _angles(rng))


def _ft_position(robot: Robot, rng: np.random.Generator) -> Change:
    values = {str(rng.choice(["x", "y"])): _signed(rng, 0.01, 0.025)}
    return Change("ft_position", _foot_sensor(robot, rng), values)


def _current_offset(robot: Robot, rng: np.random.Generator) -> Change:
    joints = [joint for joint in _leg_joints(robot) if joint in robot.motors]
    return Change("current_offset", str(rng.choice(joints)), {"offset": _signed(rng, 0.3, 0.8)})


def _sole_compliance(robot: Robot, rng: np.random.Generator) -> Change:
    values = {key: _rounded(rng.uniform(2e-4, 6e-4)) for key in ("tilt_x", "tilt_y")}
    return Change("sole_compliance", str(rng.choice(list(robot.feet))), values)


KINDS: Mapping[str, Draw] = MappingProxyType(
    {
        "payload": _payload,
        "ft_gain": _ft_gain,
        "ft_bias": _ft_bias,
        "ft_mounting": _ft_mounting,
        "joint_offset": _joint_offset,
        "joint_compliance": _joint_compliance,
        "torque_constant": _torque_constant,
        "ground_tilt": _ground_tilt,
        "imu_mounting": _imu_mounting,
        "ft_position": _ft_position,
        "current_offset": _current_offset,
        "sole_compliance": _sole_compliance,
    }
)
"""How every kind of fault is drawn, by the name of its effect."""

_DEGREE = np.pi / 180.0


def _foot_sensor(robot: Robot, rng: np.random.Generator) -> str:
    names = [foot.sensor for foot in robot.feet.values() if foot.sensor is not None]
    return names[rng.integers(len(names))]


def _leg_joints(robot: Robot) -> list[str]:
    """Return the joints between the feet: those that close the chain over the floor."""
    tree = robot.tree
    feet = [tree.link_index[foot.link] for foot in robot.feet.values()]
    beyond = {name: int(tree.subtree(name)[feet].sum()) for name in tree.joint_names}
    return [name for name, count in beyond.items() if 0 < count < max(len(feet), 2)]


def _angles(rng: np.random.Generator) -> dict[str, float]:
    return {key: _signed(rng, 0.6, 2.0, _DEGREE) for key in ("roll", "pitch")}


def _signed(rng: np.random.Generator, least: float, most: float, unit: float = 1.0) -> float:
    """Draw a size between two bounds, and its sign; rounded in its unit, returned in SI."""
    return _rounded(rng.uniform(least, most) * rng.choice([-1.0, 1.0])) * unit


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
