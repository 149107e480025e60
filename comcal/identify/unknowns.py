# SPDX-License-Identifier: Apache-2.0
"""What is identified: masses and first moments of the robot's bodies, and tares where unknown.

A *body* is what fixed joints hold together on one side of a sensor cut; it stands under the name of
its heaviest link, whose unknowns take what the others deviate from the URDF. Bodies below a cut of
a foot come from the URDF, as ``robot.yaml`` states; so do bodies too light to matter. Everything
else is free: no prior.

With known masses (the default) only the mass of the whole robot and the first moments are free:
errors of link masses move link CoMs, not the predicted total CoM. With free masses each body's mass
is an unknown of its own; what the poses determine is then the same plus nothing, in other words:
combinations of masses and moments.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.robot.model import Robot
from comcal.robot.tree import Array

NEGLIGIBLE_MASS = 1e-4
"""Bodies lighter than this share of the robot keep the CoM of the URDF: 1 cm of error of such a
body moves the total CoM by a micrometre."""

MOMENT_LENGTH = 0.1
"""Length that makes first moments comparable when singular values are judged [m]."""

OFFSET_SHARE = 0.01
"""Size of a tare as a share of the robot's weight, for the same purpose."""

AXES = "xyz"
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class Unknowns:
    """The vector theta: mass or masses, then h of every free body, then tares.

    Parameters
    ----------
    robot : Robot
    links : tuple of int
        Links that stand for the free bodies, in tree order.
    free_masses : bool
        One mass per free body instead of that of the whole robot.
    offsets : tuple of str
        Sensors whose offset is unknown: measured = true + offset, six numbers each.
    """

    robot: Robot
    links: tuple[int, ...]
    free_masses: bool = False
    offsets: tuple[str, ...] = ()

    @property
    def n_masses(self) -> int:
        """Number of leading entries of theta that are masses."""
        return len(self.links) if self.free_masses else 1

    @property
    def first_offset(self) -> int:
        """Column of the first tare."""
        return self.n_masses + 3 * len(self.links)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.first_offset + 6 * len(self.offsets)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """``mass`` or ``LINK mass``, ``LINK x`` .. ``z`` (first moments, link frame), tares."""
        links = [self.robot.tree.links[k].name for k in self.links]
        return (
            *([f"{link} mass" for link in links] if self.free_masses else ["mass"]),
            *(f"{link} {a}" for link in links for a in AXES),
            *(f"{sensor} offset {c}" for sensor in self.offsets for c in CHANNELS),
        )

    @cached_property
    def scale(self) -> Array:
        """Typical size of each unknown, shape (size,) [kg], [kg m], [N], [N m]."""
        weight = self.robot.tree.total_mass * self.robot.gravity
        offset = np.repeat([1.0, MOMENT_LENGTH], 3) * OFFSET_SHARE * weight
        return np.concatenate(
            [
                self.body_masses if self.free_masses else [self.robot.tree.total_mass],
                np.repeat(self.body_masses * MOMENT_LENGTH, 3),
                np.tile(offset, len(self.offsets)),
            ]
        )

    @cached_property
    def body_masses(self) -> Array:
        """Mass of each free body as the URDF has it, at least that of its link, (n,) [kg]."""
        bodies = rigid_parts(self.robot)
        masses = np.abs(self.robot.tree.masses)
        return np.array([masses[bodies == bodies[k]].sum() for k in self.links])

    @cached_property
    def cad(self) -> Array:
        """What the URDF says, shape (size,); tares are zero."""
        tree = self.robot.tree
        at = list(self.links)
        masses = tree.masses[at] if self.free_masses else np.array([tree.total_mass])
        h = (tree.masses[:, None] * tree.coms)[at]
        return np.concatenate([masses, h.ravel(), np.zeros(6 * len(self.offsets))])

    @cached_property
    def cad_sigma(self) -> Array:
        """Healthy spread of the URDF's values (``tolerances``), shape (size,).

        With free masses, that of a moment at the URDF's mass; tares have none, their scale stands
        for it.
        """
        tolerances, tree = self.robot.tolerances, self.robot.tree
        masses = np.abs(tree.masses[list(self.links)])
        if self.free_masses:
            mass_sigma = tolerances.link_mass * masses
        else:
            mass_sigma = np.array([tolerances.link_mass * float(np.linalg.norm(tree.masses))])
        h_sigma = np.repeat(masses * tolerances.link_com, 3)
        return np.concatenate([mass_sigma, h_sigma, self.scale[self.first_offset :]])

    def link_masses(self, theta: Array) -> Array:
        """Return the mass of every link, shape (n_links,) [kg]: free ones from *theta*, else URDF.

        With known masses they need not add up to the mass of the whole robot, which is measured.
        """
        masses = self.robot.tree.masses.copy()
        if self.free_masses:
            masses[list(self.links)] = theta[: len(self.links)]
        return masses

    def moments(self, theta: Array) -> Array:
        """Return h of every link, shape (n_links, 3) [kg m]: free ones from *theta*, else URDF."""
        h = self.robot.tree.masses[:, None] * self.robot.tree.coms
        h[list(self.links)] = theta[self.n_masses : self.first_offset].reshape(-1, 3)
        return h

    def mass_functional(self, counted: npt.NDArray[np.bool_]) -> tuple[Array, float]:
        """Return the mass of the links *counted* as an affine function of theta.

        Parameters
        ----------
        counted : array of bool, shape (n_links,)

        Returns
        -------
        L : array, shape (size,)
        known : float
            Mass = L theta + known [kg].
        """
        masses = self.robot.tree.masses
        L = np.zeros(self.size)
        if not self.free_masses:
            L[0] = 1.0
            return L, -float(masses[~counted].sum())
        at = np.array(self.links, np.intp)
        L[: len(at)] = counted[at]
        rest = counted.copy()
        rest[at] = False
        return L, float(masses[rest].sum())

    def mass(self, theta: Array, counted: npt.NDArray[np.bool_] | None = None) -> float:
        """Return the mass of the links *counted* (default: all) [kg]."""
        every = np.ones(len(self.robot.tree.links), np.bool_)
        L, known = self.mass_functional(every if counted is None else counted)
        return float(L @ theta) + known

    def column(self, link: int) -> int | None:
        """Return the column of a link's x component, or None when it is not free."""
        return self.n_masses + 3 * self.links.index(link) if link in self.links else None

    def mass_column(self, link: int) -> int | None:
        """Return the column of a link's mass, or None when it has none of its own."""
        return self.links.index(link) if self.free_masses and link in self.links else None

    def offset_columns(self, sensor: str) -> slice | None:
        """Return the columns of a sensor's tare, or None when it is known."""
        if sensor not in self.offsets:
            return None
        start = self.first_offset + 6 * self.offsets.index(sensor)
        return slice(start, start + 6)


def rigid_parts(robot: Robot) -> npt.NDArray[np.intp]:
    """Return the body of every link, shape (n_links,), as the index of the body's first link.

    Fixed joints hold a body together; a fixed joint that is a sensor's cut does not.
    """
    tree = robot.tree
    cuts = {sensor.joint for sensor in robot.sensors.values()}
    body = np.arange(len(tree.links), dtype=np.intp)
    for k, joint in enumerate(tree.joints, start=1):
        if not joint.is_movable and joint.name not in cuts:
            body[k] = body[tree.parents[k]]
    return body


def unknowns_of(
    robot: Robot, *, free_masses: bool = False, offsets: tuple[str, ...] = ()
) -> Unknowns:
    """Return what is free on *robot*.

    Parameters
    ----------
    robot : Robot
    free_masses : bool
        One mass per body instead of that of the whole robot alone.
    offsets : tuple of str
        Sensors whose tare is not known.
    """
    return Unknowns(robot, tuple(sorted(_free_links(robot))), free_masses, offsets)


def _free_links(robot: Robot) -> Iterator[int]:
    """Yield the heaviest link of every body that is free."""
    tree = robot.tree
    masses = np.abs(tree.masses)
    given = np.zeros(len(masses), dtype=np.bool_)
    for sensor, below in robot.below_cut.items():
        if any(foot.sensor == sensor for foot in robot.feet.values()):
            given |= below
    bodies = rigid_parts(robot)
    for first in np.unique(bodies):
        members = np.flatnonzero((bodies == first) & ~given)
        if members.size and masses[members].sum() > NEGLIGIBLE_MASS * tree.total_mass:
            yield int(members[np.argmax(masses[members])])
