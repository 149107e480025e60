# SPDX-License-Identifier: Apache-2.0
"""The wrench that a moving robot needs besides its weight, in quasi-static data.

It acts on the balance of the feet, the cuts and the joint torques alike. What the acceleration
does to the reading of the IMU is not taken out.
"""

from __future__ import annotations

from dataclasses import replace

from comcal.effects.effect import Effect, State
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change


def _inertia(assumed: Assumed, table: PoseTable, change: Change) -> State:
    return replace(assumed, inertia=assumed.inertia + change.number("factor")), table


INERTIA = Effect(
    name="inertia",
    correct=_inertia,
    fault={"factor": 1.0},
    signature="forces and moments in proportion to the measured acceleration",
    separated_by="the same motion, slower",
    remedy="take the inertia into account, or measure at rest",
)
EFFECTS = (INERTIA,)
