# SPDX-License-Identifier: Apache-2.0
"""Mistakes of wiring and configuration: the right readings under a wrong name, sign or unit.

They have no size that could be small or large, hence no ``fault``: a search over sizes leaves them
out, and each is tried as it stands. Undoing one is a matter of rows and factors. Errors stated of
the readings go with them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from comcal.effects.effect import Effect, Stage, State
from comcal.effects.readings import raw_sign
from comcal.measure.columns import channel_noise
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import IMU, Change, channels_of, target_kind
from comcal.robot.changes_kinds import TargetKind
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS, JOINT_CHANNELS
from comcal.robot.model import Robot
from comcal.robot.tree import Array

_FIELDS = {
    "q": ("q", "q_cov", "encoder"),
    "i": ("current", "current_var", "current"),
    "tau": ("torque", "torque_var", "torque"),
}
"""Values, variances and family of ``noise`` of the channels of a joint."""


def _channels(change: Change, kind: TargetKind) -> tuple[str, ...]:
    return change.words("channels") or channels_of(kind)


def _scaled(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """Undo a factor on channels: true = reading / factor."""
    kind = target_kind(change, assumed.robot)
    channels, factor = _channels(change, kind), 1.0
    if change.effect == "unit_error":
        factor = 1.0 / change.number("factor", 1.0)
    elif change.effect == "sign_flip":
        factor = -1.0
    else:
        axis = change.words("axis")[0]
        channels, factor = tuple(c for c in channels if c.endswith(axis)), -1.0
    if kind is TargetKind.JOINT:
        return assumed, _scaled_joint(assumed.robot, table, change.target, channels, factor)
    names = IMU_CHANNELS if kind is TargetKind.IMU else CHANNELS
    factors = np.array([factor if c in channels else 1.0 for c in names])
    return assumed, _mixed(assumed.robot, table, change.target, np.diag(factors))


def _scaled_joint(
    robot: Robot, table: PoseTable, joint: str, channels: tuple[str, ...], factor: float
) -> PoseTable:
    k = robot.tree.joint_names.index(joint)
    for channel in channels:
        field, field_var, family = _FIELDS[channel]
        values, variances = getattr(table, field).copy(), getattr(table, field_var).copy()
        values[:, k] *= factor
        variances[:, k] *= _of_errors(robot, family, variances[:, k], factor) ** 2
        table = replace(table, **{field: values, field_var: variances})
    return table


def _of_errors(robot: Robot, family: str, variance: Array, factor: float) -> float:
    """Return the factor of the errors stated of readings that get another unit.

    Errors found from the samples are in the unit of the readings, errors that robot.yaml states
    are in SI: what comes nearer to what robot.yaml states tells which of them it was.
    """
    noise = robot.noise
    stated = np.hypot(getattr(noise, family), noise.revisit.get(family, 0.0))
    known = variance[np.nan_to_num(variance) > 0.0]
    if not stated or not known.size:
        return factor
    distance = 0.5 * float(np.log(np.median(known))) - float(np.log(stated))
    return factor if abs(distance + np.log(abs(factor))) <= abs(distance) else 1.0


def _mixed(robot: Robot, table: PoseTable, target: str, A: Array) -> PoseTable:
    """Take other channels of the IMU, or of one force sensor: *A* times the reading."""
    if target == IMU and target not in table.wrench:
        return replace(table, imu=table.imu @ A.T, imu_var=table.imu_var @ (A**2).T)
    if target not in table.wrench:
        return table
    cov = table.wrench_cov[target]
    errors = A.copy()
    for k in np.flatnonzero(np.abs(np.diag(A)) > 0.0):
        family = channel_noise(CHANNELS[k])
        errors[k, k] = _of_errors(robot, family, cov[:, k, k], float(A[k, k]))
    tares = {
        name: errors @ tare @ errors.T if name == target else tare
        for name, tare in table.tare_cov.items()
    }
    return replace(
        table,
        wrench={**table.wrench, target: table.wrench[target] @ A.T},
        wrench_cov={**table.wrench_cov, target: errors @ cov @ errors.T},
        tare_cov=tares,
    )


def _swapped(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """Exchange two channels of one target, or the same channels of two."""
    robot, kind = assumed.robot, target_kind(change, assumed.robot)
    if not change.words("other"):
        names = IMU_CHANNELS if kind is TargetKind.IMU else CHANNELS
        order = np.arange(len(names))
        first, second = (names.index(c) for c in change.words("channels"))
        order[[first, second]] = second, first
        return assumed, _mixed(robot, table, change.target, np.eye(len(names))[order])
    other, channels = change.words("other")[0], _channels(change, kind)
    if kind is TargetKind.SENSOR:
        return assumed, _swapped_sensors(robot, table, change.target, other, channels)
    pair = [robot.tree.joint_names.index(name) for name in (change.target, other)]
    order = np.arange(len(robot.tree.joint_names))
    order[pair] = order[pair[::-1]]
    for channel in channels:
        field, field_var, _ = _FIELDS[channel]
        values, variances = getattr(table, field), getattr(table, field_var)
        table = replace(table, **{field: values[:, order], field_var: variances[:, order]})
    return assumed, table


def _swapped_sensors(
    robot: Robot, table: PoseTable, one: str, other: str, channels: tuple[str, ...]
) -> PoseTable:
    if one not in table.wrench or other not in table.wrench:
        return table
    # What was exchanged is what the sensors say; in the table both act from ground on robot.
    sign = raw_sign(robot, one) * raw_sign(robot, other)
    moved = np.array([c in channels for c in CHANNELS])

    def covariance(of: Array, instead: Array) -> Array:
        both_stay = np.logical_and.outer(~moved, ~moved)
        both_move = np.logical_and.outer(moved, moved)
        return np.where(both_stay, of, 0.0) + np.where(both_move, instead, 0.0)

    def exchanged(a: str, b: str) -> tuple[Array, Array, Array]:
        none = np.zeros((6, 6))
        return (
            np.where(moved, sign * table.wrench[b], table.wrench[a]),
            covariance(table.wrench_cov[a], table.wrench_cov[b]),
            covariance(table.tare_cov.get(a, none), table.tare_cov.get(b, none)),
        )

    new = {one: exchanged(one, other), other: exchanged(other, one)}
    tared = one in table.tare_cov or other in table.tare_cov
    return replace(
        table,
        wrench={**table.wrench, **{name: w for name, (w, _, _) in new.items()}},
        wrench_cov={**table.wrench_cov, **{name: cov for name, (_, cov, _) in new.items()}},
        tare_cov={**table.tare_cov, **{name: tare for name, (_, _, tare) in new.items()}}
        if tared
        else table.tare_cov,
    )


def scaled_readings(change: Change, robot: Robot, table: PoseTable) -> int:
    """Return how many readings of *table* a change of sign or unit multiplies.

    Parameters
    ----------
    change : Change
        ``sign_flip``, ``unit_error`` or ``frame_handedness``.
    robot : Robot
    table : PoseTable
    """
    kind = target_kind(change, robot)
    channels = _channels(change, kind)
    if kind is TargetKind.JOINT:
        k = robot.tree.joint_names.index(change.target)
        columns = [getattr(table, _FIELDS[c][0])[:, k] for c in channels]
    elif kind is TargetKind.IMU:
        columns = [table.imu[:, IMU_CHANNELS.index(c)] for c in channels]
    else:
        columns = [table.wrench[change.target][:, CHANNELS.index(c)] for c in channels]
    return int(sum(np.isfinite(column).sum() for column in columns))


def measured_channels(robot: Robot, table: PoseTable, joint: str) -> tuple[str, ...]:
    """Return the channels of a joint of which *table* has a reading."""
    k = robot.tree.joint_names.index(joint)
    present: list[npt.NDArray[np.bool_]] = [
        np.isfinite(getattr(table, _FIELDS[c][0])[:, k]) for c in JOINT_CHANNELS
    ]
    return tuple(c for c, there in zip(JOINT_CHANNELS, present, strict=True) if there.any())


CHANNEL_SWAP = Effect(
    name="channel_swap",
    correct=_swapped,
    stage=Stage.WIRING,
    fault={},
    signature="two channels carry what the other should",
    separated_by="poses that load one of the two alone",
    remedy="exchange the two in the wiring, or in the map of `comcal import`",
)
SIGN_FLIP = Effect(
    name="sign_flip",
    correct=_scaled,
    stage=Stage.WIRING,
    fault={},
    signature="residuals of twice the reading",
    separated_by="poses in which the reading is far from zero",
    remedy="turn the sign in the configuration; of a whole sensor, its `sense` in robot.yaml",
)
UNIT_ERROR = Effect(
    name="unit_error",
    correct=_scaled,
    stage=Stage.WIRING,
    fault={},
    signature="readings that are too large or too small by one known factor",
    separated_by="poses in which the reading is far from zero",
    remedy="say the unit in the map of `comcal import`, or log in SI",
)
FRAME_HANDEDNESS = Effect(
    name="frame_handedness",
    correct=_scaled,
    stage=Stage.WIRING,
    fault={},
    signature="force and moment along one axis have the wrong sign",
    separated_by="poses with forces along, and moments about, that axis",
    remedy="turn that axis in the sensor's configuration: its frame is left-handed",
)
LEFT_RIGHT_SWAP = Effect(
    name="left_right_swap",
    correct=_swapped,
    stage=Stage.WIRING,
    fault={},
    signature="one side reads what belongs to the other",
    separated_by="poses that differ between left and right; a lifted foot",
    remedy="exchange the two in the wiring, or in the configuration",
)
EFFECTS = (CHANNEL_SWAP, SIGN_FLIP, UNIT_ERROR, FRAME_HANDEDNESS, LEFT_RIGHT_SWAP)
