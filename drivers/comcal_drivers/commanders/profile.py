# SPDX-License-Identifier: Apache-2.0
"""One motion of all joints, in the units that each drive counts in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from comcal.errors import ConfigError
from comcal.robot.tree import Array

TURN = 2.0 * math.pi
SMALLEST, LARGEST = -(2**31), 2**31 - 1


@dataclass(frozen=True)
class JointUnits:
    """How a drive counts the position and the speed of its joint.

    Parameters
    ----------
    joint : str
    counts_per_turn : float
        Of the motor.
    gear : float
        Turns of the motor per turn of the joint.
    sign : int
        +1 or -1.
    zero : float
        Joint position at 0 counts [rad].
    speed_unit : float
        What one unit of 0x6081 is at the joint [rad/s]; of 0x6083 the same per second.
    """

    joint: str
    counts_per_turn: float
    gear: float
    sign: int
    zero: float
    speed_unit: float

    @property
    def counts_per_radian(self) -> float:
        """Signed, at the joint."""
        return self.sign * self.counts_per_turn * self.gear / TURN

    def position(self, counts: float) -> float:
        """Return the joint position [rad]."""
        return counts / self.counts_per_radian + self.zero

    def counts(self, position: float, lower: float, upper: float) -> int:
        """Return the whole count nearest to *position* [rad] that lies within the limits.

        Raises
        ------
        ConfigError
            If the drive cannot count that far.
        """
        counts = round((position - self.zero) * self.counts_per_radian)
        inward = 1 if self.counts_per_radian > 0.0 else -1
        if self.position(counts) > upper:
            counts -= inward
        elif self.position(counts) < lower:
            counts += inward
        if not SMALLEST <= counts <= LARGEST:
            raise ConfigError(
                f"joint {self.joint}: the drive cannot count to this position",
                measured=f"{counts} counts",
                limit="32 bits",
                next_step="check counts_per_turn, gear and zero in robot.yaml",
            )
        return counts

    def speed(self, speed: float) -> int:
        """Return a speed or acceleration [rad/s or rad/s^2] in whole units, rounded down."""
        return max(1, math.floor(speed / self.speed_unit + 1e-9))


def speed_unit_at_joint(unit: str, exponent: int, counts_per_turn: float, gear: float) -> float:
    """Return what one velocity unit of a drive is at the joint [rad/s].

    Parameters
    ----------
    unit : str
        ``rpm`` of the motor, or ``counts/s``.
    exponent : int
        Power of ten on top: -3 where the drive counts in thousandths.
    counts_per_turn : float
        Of the motor.
    gear : float
        Turns of the motor per turn of the joint.
    """
    per_second = {"rpm": TURN / 60.0, "counts/s": TURN / counts_per_turn}[unit]
    return per_second * 10.0**exponent / abs(gear)


def equal_duration(distance: Array, speed: float, acceleration: float) -> tuple[Array, Array]:
    """Return the speed and acceleration of every joint so that all arrive together.

    The joint with the longest way gets the full speed and acceleration, the others their share of
    both: every joint then runs the same trapezoid, scaled.

    Parameters
    ----------
    distance : array, shape (n,)
        Way of every joint [rad], of either sign.
    speed, acceleration : float
        Largest of any joint [rad/s], [rad/s^2].

    Returns
    -------
    speeds, accelerations : array, shape (n,)
        [rad/s], [rad/s^2]; zero where there is no way to go.
    """
    way = np.abs(distance)
    longest = float(way.max(initial=0.0))
    share = way / longest if longest > 0.0 else np.zeros_like(way)
    return speed * share, acceleration * share


def motion_time(longest: float, speed: float, acceleration: float) -> float:
    """Return how long the longest way takes [s]: a trapezoid, or a triangle on a short way."""
    if longest <= speed**2 / acceleration:
        return 2.0 * math.sqrt(longest / acceleration)
    return longest / speed + speed / acceleration
