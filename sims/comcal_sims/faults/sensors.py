# SPDX-License-Identifier: Apache-2.0
"""What the electronics of force/torque sensors and motors make of the truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal.robot.changes import Change, joints_of
from comcal.robot.changes_table import CHANNELS
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal_sims.faults.bodies import rotation_of

_MOUNTING = ("rx", "ry", "rz")


class WrenchFaults:
    """One force/torque sensor: matrix, offset, drift, temperature, delay and creep.

    Parameters
    ----------
    changes : sequence of Change
        Those of this sensor count; its mounting is not made here, but says in which axes the
        errors of the matrix are stated.
    sensor : str
    """

    def __init__(self, changes: Sequence[Change], sensor: str) -> None:
        matrix = np.eye(6)
        self._bias, self._drift, self._warmth = np.zeros((3, 6))
        self._delay = self._creep = self._curvature = 0.0
        R = np.eye(3)
        for change in (c for c in changes if c.target == sensor):
            wrench = np.array(change.numbers(*CHANNELS))
            if change.effect == "ft_bias":
                self._bias = self._bias + wrench
            elif change.effect == "ft_drift":
                self._drift = self._drift + wrench
            elif change.effect == "ft_temperature":
                self._warmth = self._warmth + wrench
            elif change.effect == "ft_gain":
                matrix += np.diag(change.numbers(*(f"gain_{c}" for c in CHANNELS)))
            elif change.effect == "ft_crosstalk":
                matrix += crosstalk_matrix(change)
            elif change.effect == "ft_mounting":
                R = R @ rotation_of(-np.array(change.numbers(*_MOUNTING)))
            elif change.effect == "timing_skew":
                self._delay += change.number("time")
            elif change.effect == "unknown" and change.words("function") == ("creep",):
                self._creep += change.number("amplitude")
            elif change.effect == "unknown" and change.words("function") == ("curvature",):
                self._curvature += change.number("amplitude")
        # The matrix is stated in the nominal axes, the wrench arrives in those of the sensor.
        turned = np.kron(np.eye(2), R.T)
        self._matrix = turned @ matrix @ turned.T
        self._t, self._w = np.zeros(0), np.zeros((0, 6))
        self._load_before: Array | None = None

    def begin(self) -> None:
        """Forget the samples of the pose before, but not how it was loaded."""
        if self._w.size:
            self._load_before = self._w[-1]
        self._t, self._w = np.zeros(0), np.zeros((0, 6))

    def reading(self, t: Array, wrench: Array, warming: Array) -> Array:
        """Return what the sensor says, before noise.

        Parameters
        ----------
        t : array, shape (n,)
            [s]
        wrench : array, shape (n, 6)
            In and about the frame in which the sensor is mounted.
        warming : array, shape (n,)
            Its temperature minus that of the first pose [K].
        """
        self._t, self._w = np.concatenate([self._t, t]), np.vstack([self._w, wrench])
        if self._delay:
            wrench = np.column_stack(
                [np.interp(t - self._delay, self._t, channel) for channel in self._w.T]
            )
        if self._creep and self._load_before is not None:
            wrench = wrench + self._creep * (self._load_before - wrench)
        bent = self._curvature * wrench[:, 2] ** 2
        wrench = wrench @ self._matrix.T
        wrench[:, 2] += bent
        return wrench + self._bias + np.outer(t, self._drift) + np.outer(warming, self._warmth)


def crosstalk_matrix(change: Change) -> Array:
    """Return E of ``ft_crosstalk``, shape (6, 6): ``fz_to_ty`` is row ty, column fz."""
    E = np.zeros((6, 6))
    for j, a in enumerate(CHANNELS):
        for i, b in enumerate(CHANNELS):
            E[i, j] = change.number(f"{a}_to_{b}")
    return E


class MotorFaults:
    """Torque constants and current sensors.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
    """

    def __init__(self, robot: Robot, changes: Sequence[Change]) -> None:
        names = robot.tree.joint_names
        self._factor, self._offset = np.ones(len(names)), np.zeros(len(names))
        self._ripple, self._phase = np.zeros(len(names)), np.zeros(len(names))
        for change in changes:
            if change.effect not in ("torque_constant", "current_offset", "unknown"):
                continue
            if change.effect == "unknown":
                if change.words("function") == ("torque_ripple",):
                    self._ripple[names.index(change.target)] += change.number("amplitude")
                    self._phase[names.index(change.target)] = change.number("phase")
                continue
            for joint in joints_of(change, robot):
                i = names.index(joint)
                self._factor[i] *= 1.0 + change.number("relative")
                self._offset[i] += change.number("offset")

    def currents(self, torques: Array, per_current: Array, q: Array) -> Array:
        """Return what the current sensors say, before noise [A].

        Parameters
        ----------
        torques : array, shape (n, n_joints)
            Of the motors, at the joints [N m].
        per_current : array, shape (n_joints,)
            Joint torque over current as designed [N m/A]; NaN without a motor.
        q : array, shape (n, n_joints)
            Where the motors are [rad]; cogs make the torque wavy.
        """
        cogs = self._ripple * np.sin(COGS * q + self._phase)
        return (torques + cogs) / (per_current * self._factor) + self._offset


COGS = 7.0
"""Waves of the torque ripple per radian of the joint."""
