# SPDX-License-Identifier: Apache-2.0
"""Stiction between motor and joint, stepped along with what the joint really does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.robot.changes import Change, joints_of
from comcal.robot.model import Robot
from comcal.robot.tree import Array

ARRIVAL = 5e-4
"""Way on which a joint with stiction arrives at its pose in the simulation [rad]."""
BREAK_AWAY = 5e-5
"""Way on which stiction builds up from nothing to all [rad]."""


class Stiction:
    """Dahl's law in its simplest form: a brush that bends, and slips once it is bent enough.

    The torque F of the brush against the motor grows with the way of the joint, at most to
    coulomb + load_factor |tau|; at rest it stays what it was. The motor exerts tau + F.

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
        self._torque = np.zeros(len(names))

    @property
    def is_absent(self) -> bool:
        """Whether all motors run freely."""
        return not (self.coulomb.any() or self.load_factor.any())

    @property
    def torque(self) -> Array:
        """What the motors have to exert beside the joint torque, shape (n_joints,) [N m]."""
        return self._torque

    @property
    def sticks(self) -> Array:
        """One for every joint with stiction, zero for others, shape (n_joints,)."""
        return ((self.coulomb > 0.0) | (self.load_factor > 0.0)).astype(np.float64)

    def start(self, q: Array) -> None:
        """Relax all brushes, with the joints at *q*, shape (n_joints,) [rad]."""
        self._q, self._torque = q, np.zeros_like(q)

    def step(self, q: Array, torques: Array) -> None:
        """Let the joints move.

        Parameters
        ----------
        q, torques : array, shape (n_joints,)
            Where they are now [rad], and what is exerted on them [N m].
        """
        largest = self.coulomb + self.load_factor * np.abs(torques)
        bent = self._torque + largest * (q - self._q) / BREAK_AWAY
        self._q, self._torque = q, np.clip(bent, -largest, largest)
