# SPDX-License-Identifier: Apache-2.0
"""Is the description of the robot believable? What ``comcal check`` says about a model.

Nothing here raises: a robot that loads is checked whole, and each finding says what to do next.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from comcal.robot.findings import Finding, Level
from comcal.robot.model import Robot
from comcal.robot.soles import box_corners
from comcal.robot.standing import check_standing
from comcal.robot.tree import Joint, Link, Tree

LIGHTEST, HEAVIEST = 0.1, 1000.0
"""Total masses that a robot may have [kg]; outside, grams or tonnes are likelier."""
_TRIANGLE_ROUNDING = 1e-3
"""Relative excess that rounding in the URDF explains."""


def check_health(robot: Robot) -> tuple[Finding, ...]:
    """Check masses, inertias, limits, sensors and feet of a robot.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of Finding
        Errors first, then warnings, then what is merely good to know. Statics never use the
        inertias: those findings are warnings, for the engines that simulate the robot.
    """
    tree = robot.tree
    findings = [
        *(Finding(Level.WARNING, note, next_step="correct the URDF") for note in tree.notes),
        *(finding for joint in tree.joints for finding in _check_joint(joint)),
        *_check_sensors(robot),
    ]
    if tree.geometry_known:
        findings += [
            *(finding for link in tree.links for finding in _check_link(link)),
            *_check_massless_bodies(tree),
            *_check_total_mass(robot),
            *_check_cuts(robot),
            *check_standing(robot),
        ]
    else:
        findings.append(
            Finding(
                Level.INFO,
                "a chain without URDF: masses and lengths are not known and not checked",
                where=robot.name,
            )
        )
    order = [Level.ERROR, Level.WARNING, Level.INFO]
    return tuple(sorted(findings, key=lambda finding: order.index(finding.level)))


def _check_link(link: Link) -> Iterator[Finding]:
    """Check mass, inertia and CoM of one link; a link without inertial is a pure frame."""
    if not link.has_inertial:
        return
    where = f"link {link.name}"
    if link.mass < 0.0:
        yield Finding(
            Level.ERROR,
            "the mass is negative",
            where,
            f"{link.mass:g} kg",
            "0 kg",
            "correct the URDF",
        )
    elif link.mass == 0.0:
        yield Finding(
            Level.WARNING,
            "the mass is zero although the link has an inertial",
            where,
            next_step="give it its mass, or remove <inertial> if it is only a frame",
        )
    else:
        yield from _check_inertia(link, where)
    yield from _check_com(link, where)


def _check_inertia(link: Link, where: str) -> Iterator[Finding]:
    """Check that some distribution of positive mass has this inertia."""
    small, middle, large = (float(moment) for moment in np.linalg.eigvalsh(link.inertia))
    moments = f"principal moments {small:.3g}, {middle:.3g}, {large:.3g} kg m^2"
    if small <= 0.0:
        yield Finding(
            Level.WARNING,
            "the inertia is not positive definite",
            where,
            moments,
            "all above 0",
            "statics do not use it, simulators do: take it from CAD again",
        )
    elif large > (small + middle) * (1.0 + _TRIANGLE_ROUNDING):
        yield Finding(
            Level.WARNING,
            "no body has this inertia: one principal moment exceeds the sum of the other two",
            where,
            moments,
            f"{small + middle:.3g} kg m^2",
            "statics do not use it, simulators do: check its axes and units",
        )


def _check_com(link: Link, where: str) -> Iterator[Finding]:
    """Check that the CoM is near the collision geometry."""
    if not link.boxes:
        return
    corners = np.vstack([box_corners(box) for box in link.boxes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    outside = float(np.linalg.norm(link.com - np.clip(link.com, low, high)))
    size = float(np.linalg.norm(high - low))
    if outside > size:
        yield Finding(
            Level.WARNING,
            "the centre of mass is far outside the collision geometry",
            where,
            f"{outside * 1e3:.0f} mm outside",
            f"{size * 1e3:.0f} mm, the size of the geometry",
            "check the units and the frame of the inertial's <origin>",
        )


def _check_massless_bodies(tree: Tree) -> Iterator[Finding]:
    """Find bodies without any inertial between two movable joints: a forgotten mass."""
    body = list(range(len(tree.links)))
    for k, joint in enumerate(tree.joints, start=1):
        if not joint.is_movable:
            body[k] = body[int(tree.parents[k])]
    has_mass = {body[k] for k, link in enumerate(tree.links) if link.has_inertial}
    carries = {
        body[int(tree.parents[k])] for k, j in enumerate(tree.joints, start=1) if j.is_movable
    }
    for k in sorted(set(body) - has_mass):
        if k > 0 and k in carries:
            yield Finding(
                Level.WARNING,
                "a body between two movable joints has no inertial",
                where=f"link {tree.links[k].name}",
                measured="0 kg",
                next_step="give it its mass; simulators may invent 1 kg",
            )


def _check_total_mass(robot: Robot) -> Iterator[Finding]:
    """Say what the robot weighs."""
    total = robot.tree.total_mass
    believable = LIGHTEST <= total <= HEAVIEST
    yield Finding(
        Level.INFO if believable else Level.WARNING,
        "total mass of the URDF" + ("" if believable else " is hard to believe"),
        where=robot.name,
        measured=f"{total:.4g} kg",
        limit="" if believable else f"{LIGHTEST:g} to {HEAVIEST:g} kg",
        next_step="compare with a pair of scales" if believable else "are the masses in kg?",
    )


def _check_joint(joint: Joint) -> Iterator[Finding]:
    """Check the limits of one joint."""
    where = f"joint {joint.name}"
    limits = f"{joint.lower:g} to {joint.upper:g}"
    if joint.lower > joint.upper:
        yield Finding(
            Level.ERROR, "the limits are reversed", where, limits, next_step="exchange them"
        )
    elif joint.lower == joint.upper:
        yield Finding(
            Level.WARNING,
            "the limits leave no room to move",
            where,
            limits,
            next_step="make the joint fixed, or give it its limits",
        )


def _check_sensors(robot: Robot) -> Iterator[Finding]:
    """Check that sensors sit on rigid joints and that feet and sensors belong together."""
    standing = {foot.sensor for foot in robot.feet.values()}
    on_plate = {name for plate in robot.plates.values() for name in plate.feet}
    for sensor in robot.sensors.values():
        where = f"sensor {sensor.name}"
        joint = robot.tree.joints[robot.tree.joint_index[sensor.joint]]
        if joint.is_movable:
            yield Finding(
                Level.WARNING,
                f"its joint {joint.name!r} is {joint.kind.value}, not fixed",
                where,
                next_step="the wrench turns with the child link; put the sensor on a fixed joint",
            )
        if sensor.name not in standing:
            yield Finding(
                Level.INFO,
                "belongs to no foot: its cut is that of a limb that does not stand",
                where,
                next_step="name it as `sensor:` of a foot if it carries one",
            )
    for foot in robot.feet.values():
        if foot.sensor is None and foot.name not in on_plate:
            yield Finding(
                Level.WARNING,
                "neither a sensor nor a plate measures what it carries",
                where=f"foot {foot.name}",
                next_step="give it `sensor:`, or list it under a plate",
            )


def _check_cuts(robot: Robot) -> Iterator[Finding]:
    """Say what hangs below each cut, and find cuts on the wrong side."""
    for name, below in robot.below_cut.items():
        sensor = robot.sensors[name]
        in_urdf = float(robot.tree.masses[below].sum())
        half = 0.5 * robot.tree.total_mass
        if in_urdf > half > 0.0:
            yield Finding(
                Level.WARNING,
                "more than half of the robot is below its cut",
                where=f"sensor {name}",
                measured=f"{in_urdf:.4g} kg",
                limit=f"{half:.4g} kg",
                next_step="is it the sensor of the other leg?",
            )
        mass = in_urdf if sensor.below is None else sensor.below.mass
        yield Finding(
            Level.INFO,
            "mass below its cut, which it does not carry",
            where=f"sensor {name}",
            measured=f"{mass:.4g} kg",
        )
