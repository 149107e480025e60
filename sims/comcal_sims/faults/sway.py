# SPDX-License-Identifier: Apache-2.0
"""A robot that still sways when its readings are taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from comcal.robot.changes import Change
from comcal.robot.model import Robot
from comcal.robot.tree import Array

RATE = 1.2
"""Of the sway [1/s]."""
DECAY = 1.5
"""Time in which it falls to a third [s]."""
SETTLED = 5e-5
"""Its amplitude at the ankles when the robot counts as settled [rad]."""


class Sway:
    """A dying sway of the whole robot about its ankles, which its servos really make.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
        ``not_settled``: how many seconds too early the robot is read.
    """

    def __init__(self, robot: Robot, changes: Sequence[Change]) -> None:
        early = [c.number("time") for c in changes if c.effect == "not_settled"]
        self._early = max(early, default=0.0)
        ankles = {foot.ankle for foot in robot.feet.values()}
        self._direction = np.array(
            [float(name in ankles) for name in robot.tree.joint_names], dtype=np.float64
        )
        self._q = self._way = np.zeros(len(robot.tree.joint_names))
        self._closed: Callable[[Array], Array] = np.copy
        self._t = 0.0

    @property
    def is_absent(self) -> bool:
        """Whether the robot is given the time to settle."""
        return self._early == 0.0

    def start(self, q: Array, closed: Callable[[Array], Array]) -> None:
        """Begin to sway.

        Parameters
        ----------
        q : array, shape (n_joints,)
            Around which [rad].
        closed : callable
            Returns the nearest angles with both feet flat.
        """
        amplitude = SETTLED * np.exp(self._early / DECAY)
        self._q, self._closed, self._t = q, closed, 0.0
        self._way = closed(q + amplitude * self._direction) - closed(q)

    def after(self, duration: float) -> Array:
        """Return where the joints are sent *duration* seconds later, shape (n_joints,) [rad]."""
        self._t += duration
        # A sine: the robot is met in the middle of its sway, not torn away from rest.
        fraction = np.exp(-self._t / DECAY) * np.sin(2.0 * np.pi * RATE * self._t)
        return self._closed(self._q + fraction * self._way)
