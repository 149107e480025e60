# SPDX-License-Identifier: Apache-2.0
"""Motor currents that do not mean the torque that constant and gear say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.effects.effect import Effect, Stage, State
from comcal.effects.readings import arrivals, joints_of
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.statics.torque_rows import motor_torque_factors


def _constant(assumed: Assumed, table: PoseTable, change: Change) -> State:
    factor = 1.0 + change.number("relative") * joints_of(assumed.robot, change)
    return assumed, replace(table, current=table.current * factor)


def _offset(assumed: Assumed, table: PoseTable, change: Change) -> State:
    offset = change.number("offset") * joints_of(assumed.robot, change)
    return assumed, replace(table, current=table.current - offset)


def _friction(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """Undo: motor torque = joint torque + (coulomb + load_factor |joint torque|) * approach."""
    factor = motor_torque_factors(assumed.robot)
    about = joints_of(assumed.robot, change)
    # A current says nothing about the torque where nobody knows which way friction helps.
    motor, side = table.current * factor, np.where(about > 0.0, arrivals(table), 0.0)
    coulomb, share = change.number("coulomb") * about, change.number("load_factor") * about
    # Where the joint's torque has the sign of the approach, friction adds share of it; else less.
    helped = motor - coulomb * side
    joint = helped / (1.0 + share * side * np.sign(helped))
    return assumed, replace(table, current=joint / factor)


TORQUE_CONSTANT = Effect(
    name="torque_constant",
    correct=_constant,
    stage=Stage.SCALE,
    fault={"relative": 0.2},
    family={"relative": "torque_constant"},
    signature="the torque row of that joint in proportion to its torque",
    separated_by="torque reversed; hanging, with no load",
    remedy="correct torque_constant in robot.yaml",
)
CURRENT_OFFSET = Effect(
    name="current_offset",
    correct=_offset,
    stage=Stage.OFFSET,
    fault={"offset": 0.5},
    family={"offset": "current_offset"},
    signature="the torque row of that joint, constant",
    separated_by="torque reversed; hanging, with no load",
    remedy="zero the current sensor",
)
JOINT_FRICTION = Effect(
    name="joint_friction",
    correct=_friction,
    fault={"coulomb": 3.0, "load_factor": 0.1},
    family={"coulomb": "joint_friction"},
    signature="the torque row of that joint flips with the approach",
    separated_by="each pose approached from both sides",
    remedy="approach from both sides and average, or measure the torque behind the gear",
)
EFFECTS = (TORQUE_CONSTANT, CURRENT_OFFSET, JOINT_FRICTION)
