# SPDX-License-Identifier: Apache-2.0
"""What an error of the values taken from CAD does to a fit.

Masses and CoMs of links below the sensor cuts, and CoMs of negligible links, are inputs of the
adjustment although nothing measures them. Their error is one and the same in every pose, so it is
no part of the poses' covariance. How much of it reaches the result depends on the supports: the
sole of the foot in the air is carried by the other one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.adjust import Adjustment
from comcal.identify.groups import Group
from comcal.identify.linearise import model_at, without_offsets
from comcal.robot.draw import links_below_cuts
from comcal.robot.tree import Array
from comcal.statics.static_rows import row_jacobian, row_regressor


@dataclass(frozen=True)
class CadInputs:
    """The values taken from CAD, and how an error of theirs moves a fit.

    Parameters
    ----------
    links : tuple of int
        Links that are not free.
    sigma : array, shape (4 n,)
        Standard deviations: the mass of each link [kg], then the CoM of each (3) [m].
    gain : array, shape (size, 4 n)
        d theta / d value.
    """

    links: tuple[int, ...]
    sigma: Array
    gain: Array

    @property
    def cov(self) -> Array:
        """Covariance of theta that comes from them, shape (size, size)."""
        root = self.gain * self.sigma
        return root @ root.T


def cad_inputs(fit: Adjustment) -> CadInputs:
    """Return the CAD inputs of a fit.

    Parameters
    ----------
    fit : Adjustment

    Notes
    -----
    A value that is assumed larger by delta moves theta by K (d residual / d value) delta, with
    K = d theta / d residual of one pose, as a measured input does. K is recovered from the stored
    sensitivity K B to the measurements, B having full row rank.
    """
    robot = fit.unknowns.robot
    given = [k for k in range(len(robot.tree.links)) if k not in fit.unknowns.links]
    below = links_below_cuts(robot)
    mass_sigma = robot.tolerances.link_mass * robot.tree.masses[given] * below[given]
    sigma = np.concatenate([mass_sigma, np.full(3 * len(given), robot.tolerances.link_com)])
    gain = np.zeros((fit.unknowns.size, sigma.size))
    for group, sensitivity in zip(fit.groups, fit.sensitivity, strict=True):
        gain += _group_gain(fit, group, sensitivity, given)
    return CadInputs(tuple(given), sigma, gain)


def _group_gain(fit: Adjustment, group: Group, sensitivity: Array, given: list[int]) -> Array:
    robot = fit.unknowns.robot
    tree, carried = robot.tree, group.carrier.carried
    inputs = without_offsets(fit.unknowns, group, fit.theta)
    balance = group.balance_at(robot, inputs)
    wrenches, _ = group.others(inputs)
    model = model_at(fit.unknowns, group, fit.theta)
    K = sensitivity @ np.linalg.pinv(row_jacobian(group.layout, balance, wrenches, model))

    mass_part, moment_part = row_regressor(group.layout, balance, balance.direction)
    moment_part = moment_part[:, :, given]
    by_mass = mass_part[:, :, given] + np.sum(moment_part * tree.coms[given], axis=-1)
    if group.layout.balance_rows and not fit.unknowns.free_masses:
        # The measured mass of the whole robot counts what is below a loaded cut; sensors do not.
        by_mass[:, 0] = robot.gravity * ~carried[given]
    by_com = moment_part * tree.masses[given, None]
    C = np.concatenate([by_mass, by_com.reshape(*by_mass.shape[:2], -1)], axis=2)
    return np.einsum("nij,njk->ik", K, C)
