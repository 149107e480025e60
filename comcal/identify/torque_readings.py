# SPDX-License-Identifier: Apache-2.0
"""Joint torques as data: measured ones, or motor currents times K, gear and sign.

Each has its own noise, and errors that all poses share: the torque constant (a relative error), the
offset of the current, and friction. Friction is a band where nobody knows from which side a joint
came to rest, and one unknown number where the approach is recorded: approached from both sides, it
cancels. Currents of a robot whose friction nobody states are not used: gearboxes hold newton metres
that no current shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.static_rows import RowLayout
from comcal.statics.torque_rows import motor_torque_factors

FRICTION = "joint_friction"
"""The tolerance without which currents say nothing about torques."""


@dataclass(frozen=True)
class TorqueReadings:
    """Torques of parent on child about (along) +axis, N poses.

    Parameters
    ----------
    joints : tuple of str
    value : array, shape (N, n_joints)
        [N m], [N]; NaN where nothing measures it.
    variance : array, shape (N, n_joints)
        What every pose has for itself, friction of unknown side included.
    gain, offset, friction : array, shape (N, n_joints)
        What one standard deviation of an error shared by all poses adds [N m], [N].
    """

    joints: tuple[str, ...]
    value: Array
    variance: Array
    gain: Array
    offset: Array
    friction: Array

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Where there is a torque that has an error, shape (N, n_joints)."""
        return np.asarray(np.isfinite(self.value) & (self.variance > 0.0), np.bool_)

    def shared(self, rows: npt.NDArray[np.intp], layout: RowLayout) -> dict[str, Array]:
        """Return what one standard deviation of each shared error does to the inputs.

        Returns
        -------
        mapping from name to array, shape (N, n_inputs, 1)
            Without those that do nothing.
        """
        roots: dict[str, Array] = {}
        kinds = {"torque_constant": self.gain, "current_offset": self.offset}
        kinds[FRICTION] = self.friction
        for k, joint in enumerate(layout.torques):
            for kind, change in kinds.items():
                if change[rows, joint].any():
                    root = np.zeros((len(rows), layout.n_inputs, 1))
                    root[:, layout.torque_columns.start + k, 0] = change[rows, joint]
                    roots[f"{kind} {self.joints[joint]}"] = root
        return roots


def unused_currents(robot: Robot, table: PoseTable) -> str:
    """Return why the motor currents of a session are not used, or an empty string."""
    if FRICTION in robot.tolerances.other or not robot.motors:
        return ""
    if not np.isfinite(table.current).any():
        return ""
    return (
        "motor currents are not used: robot.yaml does not say how much friction they may hide "
        "(tolerances: joint_friction, in N m; 0 where there is none)"
    )


def torque_readings(robot: Robot, table: PoseTable) -> TorqueReadings:
    """Return what a session says of joint torques; measured ones win over currents.

    Parameters
    ----------
    robot : Robot
        Its ``motors`` turn currents into torques; its ``tolerances`` say how well.
    table : PoseTable
    """
    tolerances = robot.tolerances.other
    factor = motor_torque_factors(robot)
    by_current = table.current * (factor if FRICTION in tolerances else np.nan)
    measured = np.isfinite(table.torque)
    value = np.where(measured, table.torque, by_current)
    variance = np.where(measured, table.torque_var, table.current_var * factor**2)
    from_current = ~measured & np.isfinite(by_current)

    coulomb = np.where(from_current, _tolerance(robot, table, FRICTION, "coulomb"), 0.0)
    side = np.nan_to_num(table.approach)
    gain = _tolerance(robot, table, "torque_constant", "relative")
    offset = _tolerance(robot, table, "current_offset", "offset")
    return TorqueReadings(
        joints=robot.tree.joint_names,
        value=value,
        variance=np.nan_to_num(variance) + np.where(side == 0.0, coulomb**2, 0.0),
        gain=np.where(from_current, gain * np.nan_to_num(value), 0.0),
        offset=np.where(from_current, offset * np.nan_to_num(factor), 0.0),
        friction=coulomb * side,
    )


def _tolerance(robot: Robot, table: PoseTable, family: str, key: str) -> Array:
    """Return how far each joint may be off, shape (n_joints,).

    Nothing where a known change says it of that joint, and how well: that is among the errors that
    all poses share.
    """
    names = robot.tree.joint_names
    known = np.array([f"{family}@{joint} {key}" in table.shared for joint in names], np.bool_)
    return np.where(known, 0.0, float(robot.tolerances.other.get(family, 0.0)))
