# SPDX-License-Identifier: Apache-2.0
"""What is assumed of a robot and of what it stands on: all that an effect may change.

Readings are assumed to be right as well: an effect of a sensor corrects the pose table instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from comcal.robot.model import Robot
from comcal.robot.tree import Array


def _zeros(n: int) -> Array:
    return np.zeros(n)


@dataclass(frozen=True)
class Load:
    """A force from outside that acts on a link.

    Parameters
    ----------
    link : int
    force : array, shape (3,)
        In axes of P, where the point is at ``anchor`` [N].
    point : array, shape (3,)
        Where it acts, in the link frame [m].
    stiffness : array, shape (3, 3)
        Force less by ``stiffness (x - anchor)``, x the place of the point in P [N/m].
    anchor : array, shape (3,)
        In P [m].
    poses : frozenset of int or None
        Ids of the poses in which it acts; None: in all.
    """

    link: int
    force: Array
    point: Array = field(default_factory=lambda: _zeros(3))
    stiffness: Array = field(default_factory=lambda: np.zeros((3, 3)))
    anchor: Array = field(default_factory=lambda: _zeros(3))
    poses: frozenset[int] | None = None


@dataclass(frozen=True)
class Assumed:
    """A robot as it is assumed to be, and the place where it stands.

    Parameters
    ----------
    robot : Robot
    floor : array, shape (2,)
        Roll and pitch of the floor [rad], ``R_world_P = Ry(pitch) Rx(roll)``.
    sole_give : mapping from foot to array, shape (2,)
        How far a sole gives way: tilt of the foot against the floor about its x and y per moment
        about them [rad/(N m)]; feet not named are rigid.
    loads : tuple of Load
    imu_tilt : array, shape (2,)
        Roll and pitch of the IMU against the frame of its link [rad].
    payloads : mapping from link to (mass, first moment)
        What of a link's mass [kg] and of its mass times CoM [kg m], shape (3,), is not the link's
        own: its own mass and CoM may be off as well.
    internal_torque : float
        Factor of the term M_2 that Muscolo 2017 (10) adds to the moment balance about y.
    inertia : float
        Factor of the wrench that the measured acceleration of the links needs; 0 is statics.
    """

    robot: Robot
    floor: Array = field(default_factory=lambda: _zeros(2))
    sole_give: Mapping[str, Array] = field(default_factory=dict[str, Array])
    loads: tuple[Load, ...] = ()
    imu_tilt: Array = field(default_factory=lambda: _zeros(2))
    payloads: Mapping[str, tuple[float, Array]] = field(
        default_factory=dict[str, tuple[float, Array]]
    )
    internal_torque: float = 0.0
    inertia: float = 0.0
