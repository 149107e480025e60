# SPDX-License-Identifier: Apache-2.0
"""How the height of the total CoM above the floor depends on the unknowns."""

from __future__ import annotations

import numpy as np

from comcal.identify.solution import total_com_functional
from comcal.identify.unknowns import Unknowns
from comcal.plan.candidates import Pool
from comcal.robot.tree import Array
from comcal.statics.configurations import placed_in_stance
from comcal.statics.support import carrier_of


def height_gradients(unknowns: Unknowns, poses: Pool) -> Array:
    """Return d(z of the whole robot's CoM in P)/d(scaled unknowns), shape (N, size) [m].

    Parameters
    ----------
    unknowns : Unknowns
    poses : Pool
    """
    robot = unknowns.robot
    mass = robot.tree.total_mass
    every = np.ones(len(robot.tree.links), np.bool_)
    by_mass, _ = unknowns.mass_functional(every)
    found = np.zeros((len(poses), unknowns.size))
    for support in sorted(set(poses.support)):
        rows = [i for i, s in enumerate(poses.support) if s == support]
        carrier, q = carrier_of(robot, support), poses.q[rows]
        L, _, root = total_com_functional(unknowns, carrier, q, whole=True)
        com = placed_in_stance(robot, carrier, q).total_com()
        # The first moment is one about the root, so the mass divides what is above that.
        height = (com - root)[:, 2]
        found[rows] = (L[:, 2] - height[:, None] * by_mass) / mass * unknowns.scale
    return found


def height_sigma(gradients: Array, information: Array, basis: Array) -> float:
    """Return the root mean square standard error of CoM heights that poses leave [m].

    What the poses do not determine (``basis``) is left out: no choice of poses changes it.

    Parameters
    ----------
    gradients : array, shape (N, size)
    information : array, shape (rank, rank)
    basis : array, shape (size, rank)
    """
    seen = gradients @ basis
    return float(np.sqrt(np.mean(np.sum(seen * np.linalg.solve(information, seen.T).T, axis=1))))
