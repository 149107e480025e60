# SPDX-License-Identifier: Apache-2.0
"""What is identified: the mass of the robot and the first moments of its links.

Link masses are taken from the URDF (their error moves link CoMs, not the predicted total CoM).
Links below a sensor cut come from the URDF too, as ``robot.yaml`` states; so do links too light to
matter. Everything else is free: no prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from comcal.robot.model import Robot
from comcal.robot.tree import Array

NEGLIGIBLE_MASS = 1e-4
"""Links lighter than this share of the robot keep the CoM of the URDF: 1 cm of error of such a
link moves the total CoM by a micrometre."""

MOMENT_LENGTH = 0.1
"""Length that makes first moments comparable when singular values are judged [m]."""

AXES = "xyz"


@dataclass(frozen=True)
class Unknowns:
    """The vector theta = (mass of the whole robot, h of every free link).

    Parameters
    ----------
    robot : Robot
    links : tuple of int
        Links whose first moment is free, in tree order.
    """

    robot: Robot
    links: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 1 + 3 * len(self.links)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """``mass``, then ``LINK x``, ``LINK y``, ``LINK z`` (first moments in the link frame)."""
        tree = self.robot.tree
        return ("mass", *(f"{tree.links[k].name} {a}" for k in self.links for a in AXES))

    @cached_property
    def scale(self) -> Array:
        """Typical size of each unknown, shape (size,) [kg], [kg m]."""
        masses = self.robot.tree.masses[list(self.links)]
        return np.concatenate(
            [[self.robot.tree.total_mass], np.repeat(np.abs(masses) * MOMENT_LENGTH, 3)]
        )

    @cached_property
    def cad(self) -> Array:
        """What the URDF says, shape (size,)."""
        tree = self.robot.tree
        h = (tree.masses[:, None] * tree.coms)[list(self.links)]
        return np.concatenate([[tree.total_mass], h.ravel()])

    @cached_property
    def cad_sigma(self) -> Array:
        """Healthy spread of the URDF's values (``tolerances``), shape (size,)."""
        tolerances, tree = self.robot.tolerances, self.robot.tree
        masses = tree.masses[list(self.links)]
        sigma_mass = tolerances.link_mass * float(np.linalg.norm(tree.masses))
        return np.concatenate([[sigma_mass], np.repeat(masses * tolerances.link_com, 3)])

    def moments(self, theta: Array) -> Array:
        """Return h of every link, shape (n_links, 3) [kg m]: free ones from *theta*, else URDF."""
        h = self.robot.tree.masses[:, None] * self.robot.tree.coms
        h[list(self.links)] = theta[1:].reshape(-1, 3)
        return h

    def column(self, link: int) -> int | None:
        """Return the column of a link's x component, or None when it is not free."""
        return 1 + 3 * self.links.index(link) if link in self.links else None


def unknowns_of(robot: Robot) -> Unknowns:
    """Return what is free on *robot*."""
    tree = robot.tree
    free = np.abs(tree.masses) > NEGLIGIBLE_MASS * tree.total_mass
    for sensor, below in robot.below_cut.items():
        if any(foot.sensor == sensor for foot in robot.feet.values()):
            free &= ~below
    return Unknowns(robot, tuple(int(k) for k in np.flatnonzero(free)))
