# SPDX-License-Identifier: Apache-2.0
"""Stiction between motor and joint, stepped along with what the joint really does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.robot.changes import Change, joints_of
from comcal.robot.model import Robot
from comcal.robot.tree import Array

BREAK_AWAY = 2e-4
"""Way on which stiction builds up from nothing to all [rad]."""


class Stiction:
    """Dahl's law in its simplest form: a brush that bends, and slips once it is bent enough.

    The brush bends with the way of the joint, at most to one; at rest it stays as it was. It is the
    stiffer the harder its faces are pressed together: against the motor it exerts its bend times
    coulomb + load_factor |tau|, also while the torque changes and the joint does not move. The
    motor exerts the joint torque tau and that.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
    """

    def __init__(self, robot: Robot, changes: Sequence[Change]) -> None:
        names = robot.tree.joint_names
        self.coulomb, self.load_factor = np.zeros(len(names)), np.zeros(len(names))
        for change in changes:
            if change.effect == "joint_friction":
                for joint in joints_of(change, robot):
                    self.coulomb[names.index(joint)] += change.number("coulomb")
                    self.load_factor[names.index(joint)] += change.number("load_factor")
        self._q = np.zeros(len(names))
        self._bend = np.zeros(len(names))

    @property
    def is_absent(self) -> bool:
        """Whether all motors run freely."""
        return not (self.coulomb.any() or self.load_factor.any())

    def arrive(self, q: Array, side: Array) -> None:
        """Let the joints come to where they are with nothing to carry, before the feet touch.

        On two feet they could not: no small motion of a closed chain takes every joint the way that
        it is wanted to go, and servos that insist would make the soles slide.

        Parameters
        ----------
        q : array, shape (n_joints,)
            Where they are [rad].
        side : array, shape (n_joints,)
            +1 for joints that came upwards, -1 downwards, 0 for those that never moved.
        """
        self._q, self._bend = q, side

    def step(self, q: Array) -> None:
        """Let the joints move to *q*, shape (n_joints,) [rad]."""
        self._bend = np.clip(self._bend + (q - self._q) / BREAK_AWAY, -1.0, 1.0)
        self._q = q

    def beside(self, torques: Array) -> Array:
        """Return what the motors have to exert beside the joint torques.

        Parameters
        ----------
        torques : array, shape (n_joints,)
            Exerted on the joints [N m].

        Returns
        -------
        array, shape (n_joints,)
            [N m]
        """
        return self._bend * (self.coulomb + self.load_factor * np.abs(torques))
