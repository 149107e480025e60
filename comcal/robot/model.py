# SPDX-License-Identifier: Apache-2.0
"""The validated content of ``robot.yaml``, joined with the tree of its URDF."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, Tree


class Sense(Enum):
    """Which way a sensor's wrench acts across its cut."""

    ON_ROBOT = "on_robot"
    """The part below the cut (ground side) acts on the part above it."""
    ON_GROUND = "on_ground"
    """The opposite."""


class Base(Enum):
    """How the root link is held."""

    FLOATING = "floating"
    FIXED = "fixed"


@dataclass(frozen=True)
class BelowCut:
    """What hangs below a sensor's cut, replacing the inertial of the URDF subtree.

    ``mass`` [kg]; ``com`` shape (3,) in the frame of the sensor's joint [m].
    """

    mass: float
    com: Array
    override: bool = False


@dataclass(frozen=True)
class Sensor:
    """A force/torque sensor at a joint of the tree.

    Its wrench is expressed in, and taken about the origin of, the frame of ``joint`` (child side).
    """

    name: str
    joint: str
    sense: Sense = Sense.ON_ROBOT
    below: BelowCut | None = None


@dataclass(frozen=True)
class Foot:
    """A foot: its link, the sensor that cuts it off, its sole and ankle.

    Parameters
    ----------
    sensor : str or None
        Name of the sensor whose cut carries this foot's load; None when only a plate sees it.
    sole : array, shape (n, 2) or None
        Corners of the sole in the sole frame, counter-clockwise [m]; None when unknown.
    T_link_sole : array, shape (4, 4)
        Sole frame in the foot link: x to the toes, y left, z the sole normal away from the ground.
    ankle : str or None
        The joint about whose axis twin poses tilt; None when the leg has no pitch joint.
    """

    name: str
    link: str
    sensor: str | None
    sole: Array | None
    T_link_sole: Array
    ankle: str | None


@dataclass(frozen=True)
class Plate:
    """A force plate under one or more feet; ``frame`` is ``world`` (= stance frame P) or a link."""

    name: str
    frame: str
    feet: tuple[str, ...]


@dataclass(frozen=True)
class Motor:
    """Torque at the joint [N m] = torque_constant * gear * sign * current [A]."""

    joint: str
    torque_constant: float
    gear: float = 1.0
    sign: int = 1


@dataclass(frozen=True)
class Noise:
    """Standard errors of a pose mean, by family, and their pose-to-pose scatter.

    ``ft_force`` [N], ``ft_moment`` [N m], ``encoder`` [rad or m], ``current`` [A],
    ``torque`` [N m], ``imu`` [m/s^2], ``com`` [m]. ``revisit`` is a separate term, added in
    quadrature: what differs between two visits of the same pose.
    """

    ft_force: float = 0.1
    ft_moment: float = 0.01
    encoder: float = 0.0
    current: float = 0.0
    torque: float = 0.0
    imu: float = 0.0
    com: float = 0.0
    revisit: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True)
class Tolerances:
    """Healthy spread of what CAD states (one sigma): how far a good robot is from its URDF."""

    link_mass: float = 0.005
    """Relative."""
    link_com: float = 0.001
    """[m] per component."""
    link_length: float = 0.0
    """[m]."""
    other: Mapping[str, float] = field(default_factory=dict[str, float])
    """Families that only the diagnosis uses."""


@dataclass(frozen=True)
class Limits:
    """Optional gate of the verdict; None where not asked."""

    com_error: float | None = None
    """Upper 95 % end of the held-out CoM error [m]."""
    mass_error: float | None = None
    """|measured - URDF| total mass [kg]."""


@dataclass(frozen=True)
class Robot:
    """A robot as comcal uses it: the tree plus everything ``robot.yaml`` says about it."""

    name: str
    tree: Tree
    gravity: float = 9.81
    base: Base = Base.FLOATING
    sensors: Mapping[str, Sensor] = field(default_factory=dict[str, Sensor])
    feet: Mapping[str, Foot] = field(default_factory=dict[str, Foot])
    plates: Mapping[str, Plate] = field(default_factory=dict[str, Plate])
    motors: Mapping[str, Motor] = field(default_factory=dict[str, Motor])
    imu_link: str | None = None
    noise: Noise = field(default_factory=Noise)
    tolerances: Tolerances = field(default_factory=Tolerances)
    limits: Limits = field(default_factory=Limits)
    sources: Mapping[str, Any] = field(default_factory=dict[str, Any])
    commanders: Mapping[str, Any] = field(default_factory=dict[str, Any])
    yaml_path: Path | None = None
    urdf_path: Path | None = None

    @cached_property
    def below_cut(self) -> Mapping[str, npt.NDArray[np.bool_]]:
        """Which links lie below each sensor's cut, by sensor, each shape (n_links,).

        Below is the side that holds the sensor's foot; for a sensor of no foot, the child side.
        """
        below: dict[str, npt.NDArray[np.bool_]] = {}
        for sensor in self.sensors.values():
            beyond = self.tree.subtree(sensor.joint)
            foot = next((f for f in self.feet.values() if f.sensor == sensor.name), None)
            foot_is_beyond = foot is None or bool(beyond[self.tree.link_index[foot.link]])
            below[sensor.name] = beyond if foot_is_beyond else ~beyond
        return below

    @cached_property
    def feet_from_left(self) -> tuple[str, ...]:
        """Names of the feet from left to right, as the robot stands at q = 0.

        Which side is left, the soles' own y axes say: names and the order in robot.yaml may not.
        """
        at = place_links(self.tree, np.zeros((1, len(self.tree.joint_names))))
        left, origin = np.zeros(3), dict[str, Array]()
        for name, foot in self.feet.items():
            R, p = at.link(foot.link)
            left += R[0] @ foot.T_link_sole[:3, 1]
            origin[name] = p[0] + R[0] @ foot.T_link_sole[:3, 3]
        return tuple(sorted(origin, key=lambda name: -float(left @ origin[name])))
