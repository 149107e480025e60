# SPDX-License-Identifier: Apache-2.0
"""Joint angles that are not what the encoder says.

tau_gravity, what weighs on the far side of a joint about +axis, is minus the torque that the joint
holds: of a leg that stands, the measured load of its foot is part of it.
"""

from __future__ import annotations

import numpy as np

from comcal.effects.effect import Effect, Stage, State
from comcal.effects.readings import arrivals, joints_of, with_angles
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.torques import held_torques
from comcal.robot.changes import Change
from comcal.robot.model import Robot
from comcal.robot.tree import Array

SETTLED = 4
"""Rounds in which spring and torque find one another; each is some ten times nearer."""
FLOATING = 1e-3
"""Torque over the weight carried, below which nobody knows its sign [m]: CoMs, and the offsets of a
foot's moments, are off by as much."""
NOTHING = 1e-9
"""The same of a joint that carries nothing but rounding errors [m]."""
LEAST_MASS = 1e-6
"""Of what is beyond a joint [kg]."""
CLOSE = 1e-4
"""Share of its way by which a spring may still move when it is taken as settled."""


def _offset(assumed: Assumed, table: PoseTable, change: Change) -> State:
    more = change.number("offset") * joints_of(assumed.robot, change)
    return assumed, with_angles(table, np.broadcast_to(more, table.q.shape))


def _compliance(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """The spring gives way to the torque in the place where it has given way: iterated."""
    give = joints_of(assumed.robot, change) / change.number("stiffness", np.inf)
    bent = table
    for _ in range(SETTLED):
        before = bent
        bent = with_angles(table, -np.nan_to_num(held_torques(assumed, bent)) * give)
        if np.nanmax(np.abs(bent.q - before.q), initial=0.0) <= CLOSE * _way(bent, table):
            break
    return assumed, bent


def _way(bent: PoseTable, table: PoseTable) -> float:
    return float(np.nanmax(np.abs(bent.q - table.q), initial=0.0))


def _backlash(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """A pose says nothing where the torque is too small to tell on which side the joint lies.

    A joint that carries nothing, or nobody knows what, is in the middle of its play.
    """
    about = joints_of(assumed.robot, change)
    torque = np.nan_to_num(held_torques(assumed, table))
    size = np.abs(torque) / _carried(assumed.robot)
    side = np.where(size < FLOATING, np.nan, -np.sign(torque))
    side = np.where(size < NOTHING, 0.0, side)
    width = change.number("half_width") * about
    return assumed, with_angles(table, np.where(about > 0.0, side, 0.0) * width)


def _carried(robot: Robot) -> Array:
    """Return the weight that a joint has to do with, shape (n_joints,) [N].

    Of a leg that of the robot, else that of all beyond the joint.
    """
    tree, g = robot.tree, robot.gravity
    feet = [tree.link_index[foot.link] for foot in robot.feet.values()]
    found = list[float]()
    for name in tree.joint_names:
        beyond = tree.subtree(name)
        mass = tree.total_mass if beyond[feet].any() else float(tree.masses[beyond].sum())
        found.append(g * max(mass, LEAST_MASS))
    return np.array(found)


def _hysteresis(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """A pose says nothing where the side from which the joint came is unknown."""
    about = joints_of(assumed.robot, change)
    width = change.number("half_width") * about
    return assumed, with_angles(table, np.where(about > 0.0, arrivals(table), 0.0) * width)


JOINT_OFFSET = Effect(
    name="joint_offset",
    correct=_offset,
    fault={"offset": 0.02},
    family={"offset": "joint_offset"},
    signature="closure and IMU constant, moments with the lever beyond the joint",
    separated_by="closure and IMU; of an arm, only an angle reference on that arm",
    remedy="zero the encoder",
)
JOINT_COMPLIANCE = Effect(
    name="joint_compliance",
    correct=_compliance,
    stage=Stage.SPRING,
    fault={"stiffness": 2e-4},
    family={"stiffness": "joint_compliance"},
    inverse="stiffness",
    signature="the angle errs in proportion to the torque",
    separated_by="loads on the joint both ways",
    remedy="model the gearbox's spring, or measure behind it",
)
BACKLASH = Effect(
    name="backlash",
    correct=_backlash,
    stage=Stage.SPRING,
    fault={"half_width": 0.005},
    family={"half_width": "backlash"},
    signature="a step where the torque changes its sign",
    separated_by="poses with the torque reversed",
    remedy="measure behind the play, or keep the torque's sign",
)
HYSTERESIS = Effect(
    name="hysteresis",
    correct=_hysteresis,
    fault={"half_width": 0.005},
    family={"half_width": "hysteresis"},
    signature="flips with the side from which the joint arrives",
    separated_by="each pose approached from both sides",
    remedy="arrive from one side only",
)
EFFECTS = (JOINT_OFFSET, JOINT_COMPLIANCE, BACKLASH, HYSTERESIS)
