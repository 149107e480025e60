# SPDX-License-Identifier: Apache-2.0
"""What gives between an encoder and its joint under load: springs and play.

The torque is that of parent on child about +axis, so the load pushes the joint by minus its sign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.robot.changes import Change, joints_of
from comcal.robot.model import Robot
from comcal.robot.tree import Array

SOFTEST_STOP = 0.05
"""Torque that moves a joint through its play at once [N m]; a smaller one moves it step by step,
for gravity may balance the joint somewhere in between."""
STOP_PER_PLAY = 200.0
"""The same torque per half width of the play [N m/rad]."""
SATURATION = 20.0
"""Torque at which a hardening gear has given three quarters of what it gives at most [N m]."""


class SeriesElements:
    """Springs, play and hardening gears of all joints.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
    """

    def __init__(self, robot: Robot, changes: Sequence[Change]) -> None:
        names = robot.tree.joint_names
        self.compliance = np.zeros(len(names))
        self.half_width = np.zeros(len(names))
        self.hardening = np.zeros(len(names))
        for change in changes:
            if change.effect == "joint_compliance":
                for joint in joints_of(change, robot):
                    self.compliance[names.index(joint)] += 1.0 / change.number("stiffness")
            elif change.effect == "backlash":
                self.half_width[names.index(change.target)] += change.number("half_width")
            elif change.effect == "unknown" and change.words("function") == ("hardening",):
                self.hardening[names.index(change.target)] += change.number("amplitude")

    def springs(self, stiffest: float) -> Array:
        """Return the compliance of the joints whose springs an engine can make, zero elsewhere.

        Parameters
        ----------
        stiffest : float
            Of the engine's springs [N m/rad]; zero: it has none.

        Returns
        -------
        array, shape (n_joints,)
            [rad/(N m)]
        """
        soft = self.compliance * stiffest > 1.0
        return np.where(soft, self.compliance, 0.0)

    @property
    def are_rigid(self) -> bool:
        """Whether nothing gives."""
        return not (self.compliance.any() or self.half_width.any() or self.hardening.any())

    def deflection(self, torques: Array, play: Array, springs: Array) -> tuple[Array, Array]:
        """Return how far joints are from where their encoders say, and where in it their play is.

        Parameters
        ----------
        torques : array, shape (n_joints,)
            Of parent on child about +axis [N m].
        play : array, shape (n_joints,)
            Where each joint was in its play before [rad].
        springs : array, shape (n_joints,)
            Compliance that is not to be counted, because the engine has it [rad/(N m)].

        Returns
        -------
        deflection, play : array, shape (n_joints,)
            [rad]; the first includes the second.
        """
        stop = np.maximum(SOFTEST_STOP, STOP_PER_PLAY * self.half_width)
        play = np.clip(play - self.half_width * torques / stop, -self.half_width, self.half_width)
        bent = self.hardening * np.tanh(torques / SATURATION)
        return play - (self.compliance - springs) * torques - bent, play
