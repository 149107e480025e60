# SPDX-License-Identifier: Apache-2.0
r"""What any body obeys: its mass is positive, and its CoM lies within its own outline.

All of it is linear in the unknowns. With the body's mass M and first moment H, both affine in them,
a CoM between two faces of a box is

.. math:: lower \cdot M \le H \le upper \cdot M .

The outline of a body is the box around all collision geometry of its links, in the frame of the
link that stands for it. Meshes are not read, so most links of most robots have none. An outline
that does not even hold the CoM of the URDF is none: some collision geometry is only where the link
may touch the ground.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from comcal.identify.unknowns import AXES, Unknowns, rigid_parts
from comcal.robot.model import Robot
from comcal.robot.soles import box_corners
from comcal.robot.tree import Array

LEAST_MASS = 0.01
"""Least mass of a link, as a share of what the URDF gives it: positive, and no division by zero."""
NOT_AN_OUTLINE = 3.0
"""In ``tolerances.link_com``: how far outside a box the URDF's CoM may lie before it is no
outline."""


@dataclass(frozen=True)
class Bound:
    """An inequality ``row @ theta <= limit``.

    Parameters
    ----------
    words : str
        What it is when theta is at it: ``r_shin CoM x at its upper bound 0.05 m of the box``.
    row : array, shape (size,)
        Zeros where it is about numbers that are not unknown.
    limit : float
    component : str
        Link and axis, ``r_shin x``, or ``r_shin mass``.
    """

    words: str
    row: Array
    limit: float
    component: str


@dataclass(frozen=True)
class Bounds:
    """All bounds of a robot, and what none could be found for.

    Parameters
    ----------
    bounds : tuple of Bound
    without : tuple of (str, str)
        Links whose CoM is not bounded, with the reason.
    """

    bounds: tuple[Bound, ...]
    without: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Body:
    """The links of a body and the one that stands for it."""

    link: int
    members: tuple[int, ...]

    @property
    def all(self) -> list[int]:
        return [self.link, *self.members]


def physical_bounds(unknowns: Unknowns) -> Bounds:
    """Return what the masses and CoMs of all bodies have to obey.

    Links whose numbers are given are held to it too: where they break a bound, no fit can help.

    Parameters
    ----------
    unknowns : Unknowns
    """
    robot = unknowns.robot
    bounds = list(_positive_masses(unknowns))
    without: list[tuple[str, str]] = []
    for body in _bodies(unknowns):
        reason = _no_outline(robot, body)
        if reason:
            without.append((robot.tree.links[body.link].name, reason))
        else:
            bounds.extend(_inside(unknowns, body))
    return Bounds(tuple(bounds), tuple(without))


def _bodies(unknowns: Unknowns) -> Iterator[_Body]:
    """Yield every body that has mass: under its free link, or else under its heaviest."""
    tree, body_of = unknowns.robot.tree, rigid_parts(unknowns.robot)
    for first in np.unique(body_of):
        links = np.flatnonzero(body_of == first)
        free = [int(k) for k in links if k in unknowns.links]
        chosen = free[0] if free else int(links[np.argmax(np.abs(tree.masses[links]))])
        if tree.masses[chosen] or free:
            yield _Body(chosen, tuple(int(k) for k in links if k != chosen))


def _positive_masses(unknowns: Unknowns) -> Iterator[Bound]:
    tree = unknowns.robot.tree
    if not unknowns.free_masses:
        row, known = unknowns.mass_functional(np.ones(len(tree.links), np.bool_))
        least = LEAST_MASS * tree.total_mass
        words = f"mass of the robot at its lower bound {least:.3g} kg"
        yield Bound(words, -row, known - least, "mass")
    for k, link in enumerate(tree.links):
        column = unknowns.mass_column(k)
        row = np.zeros(unknowns.size)
        if column is not None:
            row[column] = -1.0
            least = LEAST_MASS * abs(link.mass)
            words = f"{link.name} mass at its lower bound {least:.3g} kg"
            yield Bound(words, row, -least, f"{link.name} mass")
        elif link.mass:
            words = f"{link.name} mass, given as {link.mass:.4g} kg, has to be positive"
            yield Bound(words, row, link.mass, f"{link.name} mass")


def _no_outline(robot: Robot, body: _Body) -> str:
    """Return why the CoM of a body is not bounded, or an empty string."""
    tree, link = robot.tree, robot.tree.links[body.link]
    if not link.boxes:
        return "no box, sphere or cylinder among its collision geometry (meshes are not read)"
    stated = any(
        sensor.below is not None and robot.below_cut[sensor.name][body.link]
        for sensor in robot.sensors.values()
    )
    mass = tree.masses[body.all].sum()
    if stated or not mass > 0.0:
        return ""  # not from the URDF, or no body at all: that is for the bounds to say
    low, high = _outline(robot, body)
    com = sum(T[:3, 3] * m for T, m in _centres(robot, body)) / mass
    outside = float(np.abs(com - np.clip(com, low, high)).max())
    if outside > NOT_AN_OUTLINE * robot.tolerances.link_com:
        return (
            f"the CoM of the URDF lies {outside * 1e3:.3g} mm outside its collision geometry, "
            "which is no outline then"
        )
    return ""


def _centres(robot: Robot, body: _Body) -> Iterator[tuple[Array, float]]:
    """Yield the pose of every CoM in the frame of the body's link, with its mass."""
    tree = robot.tree
    for k in body.all:
        T = _in_body(robot, body, k).copy()
        T[:3, 3] += T[:3, :3] @ tree.coms[k]
        yield T, float(tree.masses[k])


def _in_body(robot: Robot, body: _Body, k: int) -> Array:
    T = robot.tree.bodies.T_leader_link
    return np.asarray(np.linalg.inv(T[body.link]) @ T[k], np.float64)


def _outline(robot: Robot, body: _Body) -> tuple[Array, Array]:
    """Return the lower and upper corner of the box around a body, in the frame of its link [m].

    A member without geometry of its own counts with its CoM.
    """
    points: list[Array] = []
    for k in body.all:
        link, T = robot.tree.links[k], _in_body(robot, body, k)
        own = np.concatenate([box_corners(box) for box in link.boxes]) if link.boxes else None
        if own is None and link.mass:
            own = link.com[None]
        if own is not None:
            points.append(own @ T[:3, :3].T + T[:3, 3])
    every = np.concatenate(points)
    return every.min(axis=0), every.max(axis=0)


def _inside(unknowns: Unknowns, body: _Body) -> Iterator[Bound]:
    """Yield the six faces of a body's outline."""
    robot, link = unknowns.robot, unknowns.robot.tree.links[body.link]
    low, high = _outline(robot, body)
    mass_row, mass, moment_rows, moment = _moments(unknowns, body)
    named = [robot.tree.links[k].name for k in body.members if robot.tree.links[k].mass]
    whose = f"{link.name} with {', '.join(named)}: CoM" if named else f"{link.name} CoM"
    given = "" if unknowns.column(body.link) is not None else " (given, not fitted)"
    for i, axis in enumerate(AXES):
        for face, sign, word in ((low[i], -1.0, "lower"), (high[i], 1.0, "upper")):
            # sign (H - face M) <= 0, what is known of H and M on the right
            yield Bound(
                words=f"{whose} {axis} at its {word} bound {face:.4g} m of the box{given}",
                row=sign * (moment_rows[i] - face * mass_row),
                limit=-sign * float(moment[i] - face * mass),
                component=f"{link.name} {axis}",
            )


def _moments(unknowns: Unknowns, body: _Body) -> tuple[Array, float, Array, Array]:
    """Return mass and first moment of a body as affine functions of theta: row, known, rows, known.

    In the frame of the body's link.
    """
    mass_row, moment_rows = np.zeros(unknowns.size), np.zeros((3, unknowns.size))
    mass, moment = 0.0, np.zeros(3)
    for k, (T, m) in zip(body.all, _centres(unknowns.robot, body), strict=True):
        column, mass_column = unknowns.column(k), unknowns.mass_column(k)
        if column is not None:
            moment_rows[:, column : column + 3] = np.eye(3)
        else:
            moment += m * T[:3, 3]
        if mass_column is not None:
            mass_row[mass_column] = 1.0
        else:
            mass += m
    return mass_row, mass, moment_rows, moment
