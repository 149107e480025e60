# SPDX-License-Identifier: Apache-2.0
"""Masses, CoMs and lengths that are not what the URDF says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comcal.effects.effect import Effect, State
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change
from comcal.robot.model import Robot
from comcal.robot.tree import Array, Joint, Link

COM = ("com_x", "com_y", "com_z")


def _with_link(robot: Robot, name: str, new: Link) -> Robot:
    k = robot.tree.link_index[name]
    links = (*robot.tree.links[:k], new, *robot.tree.links[k + 1 :])
    return replace(robot, tree=replace(robot.tree, links=links))


def _link(assumed: Assumed, change: Change) -> Link:
    return assumed.robot.tree.links[assumed.robot.tree.link_index[change.target]]


def _own(assumed: Assumed, link: Link) -> tuple[float, Array]:
    """Return mass and CoM of a link without what it carries."""
    carried, moment = assumed.payloads.get(link.name, (0.0, np.zeros(3)))
    mass = link.mass - carried
    return mass, (link.mass * link.com - moment) / mass if carried and mass else link.com


def _payload(assumed: Assumed, table: PoseTable, change: Change) -> State:
    link, more = _link(assumed, change), change.number("mass")
    added = more * np.array(change.numbers(*COM))
    moment = link.mass * link.com + added
    mass = link.mass + more
    com = moment / mass if mass else link.com
    arm = np.array(change.numbers(*COM)) - link.com
    # Of a point: what its own size adds is not known.
    point = link.mass * more / mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)) if mass else 0.0
    joined = replace(link, mass=mass, com=com, inertia=link.inertia + point)
    robot = _with_link(assumed.robot, change.target, joined)
    carried, carried_moment = assumed.payloads.get(link.name, (0.0, np.zeros(3)))
    payloads = {**assumed.payloads, link.name: (carried + more, carried_moment + added)}
    return replace(assumed, robot=robot, payloads=payloads), table


def _link_mass(assumed: Assumed, table: PoseTable, change: Change) -> State:
    link, more = _link(assumed, change), change.number("mass")
    mass = link.mass + more
    heavier = _denser(link, mass / link.mass) if link.mass else replace(link, mass=mass)
    if change.target in assumed.payloads and mass:
        _, com = _own(assumed, link)
        heavier = replace(heavier, com=(link.mass * link.com + more * com) / mass)
    return replace(assumed, robot=_with_link(assumed.robot, change.target, heavier)), table


def _denser(link: Link, factor: float) -> Link:
    return replace(link, mass=link.mass * factor, inertia=link.inertia * factor)


def _link_com(assumed: Assumed, table: PoseTable, change: Change) -> State:
    link = _link(assumed, change)
    own, _ = _own(assumed, link)
    share = own / link.mass if change.target in assumed.payloads and link.mass else 1.0
    moved = replace(link, com=link.com + share * np.array(change.numbers(*COM)))
    return replace(assumed, robot=_with_link(assumed.robot, change.target, moved)), table


def _sole_mass(assumed: Assumed, table: PoseTable, change: Change) -> State:
    """The mass is added to the links below the cut in proportion to theirs."""
    robot = assumed.robot
    below = robot.below_cut[change.target]
    mass = float(robot.tree.masses[below].sum())
    factor = 1.0 + change.number("mass") / mass if mass else 1.0
    links = tuple(
        _denser(link, factor) if below[k] else link for k, link in enumerate(robot.tree.links)
    )
    return replace(assumed, robot=replace(robot, tree=replace(robot.tree, links=links))), table


def _link_length(assumed: Assumed, table: PoseTable, change: Change) -> State:
    tree = assumed.robot.tree
    shift = np.array(change.numbers("x", "y", "z"))

    def moved(joint: Joint) -> Joint:
        T = joint.T_parent_joint.copy()
        T[:3, 3] += shift
        return replace(joint, T_parent_joint=T)

    joints = tuple(moved(j) if j.name == change.target else j for j in tree.joints)
    robot = replace(assumed.robot, tree=replace(tree, joints=joints))
    return replace(assumed, robot=robot), table


PAYLOAD = Effect(
    name="payload",
    correct=_payload,
    fault={"mass": 3.0, **dict.fromkeys(COM, 0.5)},
    moments=COM,
    signature="the weight grows, moments and torques of the joints below follow that link",
    separated_by="poses that move the joints next to the link",
    remedy="add the body to the URDF, or take it off",
)
LINK_MASS = Effect(
    name="link_mass",
    correct=_link_mass,
    fault={"mass": 1.0},
    family={"mass": "link_mass"},
    signature="the weight grows, at that link's CoM",
    separated_by="poses with a long lever to that link",
    remedy="weigh the link, correct its mass in the URDF",
)
LINK_COM = Effect(
    name="link_com",
    correct=_link_com,
    fault=dict.fromkeys(COM, 0.03),
    family=dict.fromkeys(COM, "link_com"),
    signature="moments turn with the link, the weight stays",
    separated_by="poses that turn the link",
    remedy="export the calibrated CoM",
)
SOLE_MASS = Effect(
    name="sole_mass",
    correct=_sole_mass,
    fault={"mass": 0.3},
    family={"mass": "sole_mass"},
    signature="only the sensor of that foot, only when it is lifted",
    separated_by="a lifted foot; nothing else shows it",
    remedy="weigh what hangs below the cut, say it under sensors.*.below",
)
LINK_LENGTH = Effect(
    name="link_length",
    correct=_link_length,
    fault=dict.fromkeys(("x", "y", "z"), 0.01),
    family=dict.fromkeys(("x", "y", "z"), "link_length"),
    signature="closure of the feet, and moments",
    separated_by="two feet on one floor; single support",
    remedy="measure the link, correct the joint's origin in the URDF",
)
EFFECTS = (PAYLOAD, LINK_MASS, LINK_COM, SOLE_MASS, LINK_LENGTH)
