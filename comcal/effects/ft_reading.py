# SPDX-License-Identifier: Apache-2.0
"""Errors of a force/torque sensor's reading.

measured w' = R(rotvec) (I + diag(gain) + E) w + b, taken about the displaced origin; b grows with
time and temperature. Each effect undoes its own part.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from comcal.effects.effect import Effect, Stage, State
from comcal.effects.readings import raw_sign, with_wrench
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.changes_table import CHANNELS
from comcal.robot.frames import rotation_about
from comcal.robot.tree import Array
from comcal.statics.wrenches import wrench_transform

FORCES = CHANNELS[:3]
T = TypeVar("T", float, str)


def _by_channel(force: T, moment: T, prefix: str = "") -> dict[str, T]:
    return {f"{prefix}{c}": force if c in FORCES else moment for c in CHANNELS}


def _added(assumed: Assumed, table: PoseTable, change: Change, factor: Array) -> State:
    """Take an offset per unit of *factor*, shape (N,), out of a sensor's reading."""
    rate = raw_sign(assumed.robot, change.target) * np.array(change.numbers(*CHANNELS))
    wrench = table.wrench[change.target] - factor[:, None] * rate
    return assumed, with_wrench(table, change.target, wrench)


def _matrix(table: PoseTable, change: Change, A: Array) -> PoseTable:
    """Undo w' = A w."""
    wrench = np.linalg.solve(A, table.wrench[change.target].T).T
    return with_wrench(table, change.target, wrench)


def _bias(assumed: Assumed, table: PoseTable, change: Change) -> State:
    return _added(assumed, table, change, np.ones(len(table)))


def _drift(assumed: Assumed, table: PoseTable, change: Change) -> State:
    return _added(assumed, table, change, np.nan_to_num(table.t))


def _temperature(assumed: Assumed, table: PoseTable, change: Change) -> State:
    nothing = np.zeros(len(table))
    degrees = table.temperature.get(change.target, table.temperature.get("", nothing))
    return _added(assumed, table, change, np.nan_to_num(degrees - degrees[0]))


def _gain(assumed: Assumed, table: PoseTable, change: Change) -> State:
    gains = np.array([change.number(f"gain_{c}") for c in CHANNELS])
    return assumed, _matrix(table, change, np.diag(1.0 + gains))


def _crosstalk(assumed: Assumed, table: PoseTable, change: Change) -> State:
    leak = [[0.0 if a == b else change.number(f"{a}_to_{b}") for a in CHANNELS] for b in CHANNELS]
    return assumed, _matrix(table, change, np.eye(6) + np.array(leak))


def _mounting(assumed: Assumed, table: PoseTable, change: Change) -> State:
    rotvec = np.array(change.numbers("rx", "ry", "rz"))
    angle = float(np.linalg.norm(rotvec))
    R = rotation_about(rotvec / angle, angle) if angle > 0.0 else np.eye(3)
    return assumed, _matrix(table, change, wrench_transform(R, np.zeros(3)))


def _position(assumed: Assumed, table: PoseTable, change: Change) -> State:
    offset = np.array(change.numbers("x", "y", "z"))
    return assumed, _matrix(table, change, wrench_transform(np.eye(3), -offset))


FT_BIAS = Effect(
    name="ft_bias",
    correct=_bias,
    stage=Stage.OFFSET,
    fault=_by_channel(10.0, 1.0),
    family=_by_channel("ft_bias_force", "ft_bias_moment"),
    signature="constant in that sensor's rows, loaded or not",
    separated_by="a pose in which that foot is in the air, or the robot hangs",
    remedy="tare the sensor with the foot lifted",
)
FT_GAIN = Effect(
    name="ft_gain",
    correct=_gain,
    stage=Stage.SCALE,
    fault=_by_channel(0.1, 0.1, "gain_"),
    family={f"gain_{c}": "ft_gain" for c in CHANNELS},
    signature="proportional to the load, nothing when lifted",
    separated_by="load on one foot, then on the other; a known weight added",
    remedy="calibrate the sensor, or write the gain into its matrix",
)
FT_CROSSTALK = Effect(
    name="ft_crosstalk",
    correct=_crosstalk,
    stage=Stage.SCALE,
    fault={
        f"{a}_to_{b}": (0.05 if a[0] == b[0] else 0.02 if a[0] == "f" else 0.5)
        for a in CHANNELS
        for b in CHANNELS
        if a != b
    },
    family={f"{a}_to_{b}": "ft_crosstalk" for a in CHANNELS for b in CHANNELS if a != b},
    signature="one channel follows another",
    separated_by="unloaded poses and loads with different forces sideways",
    remedy="calibrate the sensor's matrix",
)
FT_MOUNTING = Effect(
    name="ft_mounting",
    correct=_mounting,
    stage=Stage.AXES,
    fault=dict.fromkeys(("rx", "ry", "rz"), 0.05),
    family=dict.fromkeys(("rx", "ry", "rz"), "ft_mounting"),
    signature="forces sideways proportional to the weight, no lever to the CoM's height",
    separated_by="a slope also moves moments with the CoM's height, and the IMU",
    remedy="correct the sensor's frame in the URDF, or turn the sensor",
)
FT_POSITION = Effect(
    name="ft_position",
    correct=_position,
    fault=dict.fromkeys(("x", "y", "z"), 0.02),
    family=dict.fromkeys(("x", "y", "z"), "ft_position"),
    signature="moments proportional to the vertical force; height, to forces sideways",
    separated_by="forces sideways: slopes, a load that is split unevenly",
    remedy="correct the sensor's frame in the URDF",
)
FT_DRIFT = Effect(
    name="ft_drift",
    correct=_drift,
    stage=Stage.OFFSET,
    fault=_by_channel(0.02, 0.002),
    signature="the same pose differs later",
    separated_by="revisits, with the temperature going up and down in between",
    remedy="tare more often; let the sensor warm up",
)
FT_TEMPERATURE = Effect(
    name="ft_temperature",
    correct=_temperature,
    stage=Stage.OFFSET,
    fault=_by_channel(2.0, 0.2),
    signature="the same pose differs at another temperature",
    separated_by="revisits at another temperature",
    remedy="compensate the temperature, or tare at the working temperature",
)
EFFECTS = (
    FT_BIAS,
    FT_GAIN,
    FT_CROSSTALK,
    FT_MOUNTING,
    FT_POSITION,
    FT_DRIFT,
    FT_TEMPERATURE,
)
