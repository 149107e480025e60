# SPDX-License-Identifier: Apache-2.0
"""Feet that do not stand where their link says: a shim, a swapped sole, another place.

The true sole stands at T = (x y z, roll pitch yaw) in the sole frame that is assumed, so what lies
flat on the floor is T_link_sole T^-1. Roll and pitch turn the floor's normal, in every support;
z shows in the height by which two soles miss one floor.

The readings are all but blind to x, y and yaw: P has its origin in the sensors, and in double
support its y axis goes from sensor to sensor. What is left of them is a turn of P against a sloping
floor (yaw, one foot), a lever on a tilted sole, and the place of P of feet that have no sensor of
their own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.effects.effect import Effect, State
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.frames import rotation_from_rpy, transform_from

PLACE, TURN = ("x", "y", "z"), ("roll", "pitch", "yaw")


def _placement(assumed: Assumed, table: PoseTable, change: Change) -> State:
    robot = assumed.robot
    T = transform_from(rotation_from_rpy(change.numbers(*TURN)), change.numbers(*PLACE))
    foot = robot.feet[change.target]
    moved = replace(foot, T_link_sole=foot.T_link_sole @ np.linalg.inv(T))
    feet = {**robot.feet, foot.name: moved}
    return replace(assumed, robot=replace(robot, feet=feet)), table


FOOT_PLACEMENT = Effect(
    name="foot_placement",
    correct=_placement,
    fault={**dict.fromkeys(PLACE, 0.01), **dict.fromkeys(TURN, 0.02)},
    family={
        **dict.fromkeys(PLACE, "foot_placement"),
        **dict.fromkeys(TURN, "foot_placement_angle"),
    },
    signature="closure constant; with that foot alone, forces sideways and the IMU",
    separated_by="single support on that foot and on the other, with an IMU; the feet placed anew",
    remedy="place the foot anew, or correct its sole in robot.yaml",
)
EFFECTS = (FOOT_PLACEMENT,)
