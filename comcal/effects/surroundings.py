# SPDX-License-Identifier: Apache-2.0
"""Floor, soles, IMU, and what pulls at the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.effects.effect import Effect, State
from comcal.measure.table import PoseTable
from comcal.predict.anchors import first_place
from comcal.predict.assumed import Assumed, Load
from comcal.robot.changes import ALL, Change

FORCE = ("force_x", "force_y", "force_z")
POINT = ("point_x", "point_y", "point_z")
DIAGONAL, BESIDE = ("k_xx", "k_yy", "k_zz"), ("k_xy", "k_xz", "k_yz")


def _tilt(change: Change) -> np.ndarray:
    return np.array(change.numbers("roll", "pitch"))


def _ground(assumed: Assumed, table: PoseTable, change: Change) -> State:
    return replace(assumed, floor=assumed.floor + _tilt(change)), table


def _imu(assumed: Assumed, table: PoseTable, change: Change) -> State:
    return replace(assumed, imu_tilt=assumed.imu_tilt + _tilt(change)), table


def _soles(assumed: Assumed, table: PoseTable, change: Change) -> State:
    give = np.array(change.numbers("tilt_x", "tilt_y"))
    feet = assumed.robot.feet if change.target == ALL else (change.target,)
    nothing = np.zeros(2)
    more = {foot: assumed.sole_give.get(foot, nothing) + give for foot in feet}
    return replace(assumed, sole_give={**assumed.sole_give, **more}), table


def _loaded(assumed: Assumed, table: PoseTable, load: Load) -> State:
    return replace(assumed, loads=(*assumed.loads, load)), table


def _cable(assumed: Assumed, table: PoseTable, change: Change) -> State:
    link = assumed.robot.tree.link_index[change.target]
    return _loaded(assumed, table, Load(link, np.array(change.numbers(*FORCE))))


def _tether(assumed: Assumed, table: PoseTable, change: Change) -> State:
    link = assumed.robot.tree.link_index[change.target]
    k = np.diag(change.numbers(*DIAGONAL))
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), change.numbers(*BESIDE), strict=True):
        k[i, j] = k[j, i] = value
    force = np.array(change.numbers(*FORCE))
    anchor = first_place(assumed, table, link)
    return _loaded(assumed, table, Load(link, force, stiffness=k, anchor=anchor))


def _contact(assumed: Assumed, table: PoseTable, change: Change) -> State:
    link = assumed.robot.tree.link_index[change.target]
    poses = change.poses()
    load = Load(
        link,
        np.array(change.numbers(*FORCE)),
        point=np.array(change.numbers(*POINT)),
        poses=None if poses is None else frozenset(poses),
    )
    return _loaded(assumed, table, load)


def _published(assumed: Assumed, table: PoseTable, change: Change) -> State:
    factor = assumed.internal_torque + change.number("factor")
    return replace(assumed, internal_torque=factor), table


GROUND_TILT = Effect(
    name="ground_tilt",
    correct=_ground,
    fault=dict.fromkeys(("roll", "pitch"), 0.02),
    family=dict.fromkeys(("roll", "pitch"), "ground_tilt"),
    signature="forces sideways, moments with the CoM's height, IMU; not closure",
    separated_by="the robot turned round on the spot",
    remedy="level the floor, or record on known slopes",
)
IMU_MOUNTING = Effect(
    name="imu_mounting",
    correct=_imu,
    fault=dict.fromkeys(("roll", "pitch"), 0.02),
    family=dict.fromkeys(("roll", "pitch"), "imu_mounting"),
    signature="the IMU alone, constant",
    separated_by="the robot turned round on the spot; hanging",
    remedy="correct the IMU's frame in the URDF",
)
SOLE_COMPLIANCE = Effect(
    name="sole_compliance",
    correct=_soles,
    fault=dict.fromkeys(("tilt_x", "tilt_y"), 2e-4),
    family=dict.fromkeys(("tilt_x", "tilt_y"), "sole_compliance"),
    signature="IMU, forces sideways and closure in proportion to that foot's moment",
    separated_by="single support with an IMU; the centre of pressure at toes and heel",
    remedy="stiffer soles, or keep the pressure central",
)
CABLE_PULL = Effect(
    name="cable_pull",
    correct=_cable,
    fault=dict.fromkeys(FORCE, 10.0),
    at_origin=True,
    signature="a constant force, and its moment at that link",
    separated_by="the trunk moved sideways; the cable unhooked once",
    remedy="unhook the cable, or hang it slack",
)
TETHER = Effect(
    name="tether",
    correct=_tether,
    fault={**dict.fromkeys(FORCE, 10.0), **dict.fromkeys((*DIAGONAL, *BESIDE), 100.0)},
    at_origin=True,
    signature="a force that follows the place of that link",
    separated_by="the trunk moved sideways; the cable unhooked once",
    remedy="unhook the cable, or hang it slack",
)
EXTERNAL_CONTACT = Effect(
    name="external_contact",
    correct=_contact,
    fault=dict.fromkeys(FORCE, 20.0),
    at_origin=True,
    signature="a force at that link, in some poses only",
    separated_by="the torques of that limb; another posture of it",
    remedy="record the poses again without the contact",
)
INTERNAL_TORQUE_TERM = Effect(
    name="internal_torque_term",
    correct=_published,
    fault={"factor": 1.0},
    signature="the moment about y follows the sum of all joint torques",
    separated_by="poses with other joint torques",
    remedy="leave M_2 out of the balance: internal torques cancel",
)
EFFECTS = (
    GROUND_TILT,
    IMU_MOUNTING,
    SOLE_COMPLIANCE,
    CABLE_PULL,
    TETHER,
    EXTERNAL_CONTACT,
    INTERNAL_TORQUE_TERM,
)
