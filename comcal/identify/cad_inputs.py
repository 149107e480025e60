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
from comcal.identify.linearise import Group
from comcal.robot.draw import links_below_cuts
from comcal.robot.frames import apply
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at, input_jacobian, moment_regressor


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
    g, tree, carried = robot.gravity, robot.tree, group.carrier.carried
    balance = balance_at(robot, group.carrier, group.q, group.w)
    B_w, B_q = input_jacobian(balance, fit.unknowns.moments(fit.theta))
    B = np.concatenate([B_w.reshape(len(B_q), 4, -1), B_q], axis=2)
    K = sensitivity @ np.linalg.pinv(B)

    at = balance.placements
    by_com = moment_regressor(balance, balance.direction)[:, :, given] * tree.masses[given, None]
    arm = at.p[:, given] + apply(at.R[:, given], tree.coms[given])
    by_mass = -g * np.cross(arm, balance.direction[:, None]) * carried[given, None]
    C = np.zeros((len(B), 4, 4 * len(given)))
    # Mass below a loaded cut is not carried; theta[0] counts it, the sensors do not.
    C[:, 0, : len(given)] = g * ~carried[given]
    C[:, 1:, : len(given)] = np.swapaxes(by_mass, 1, 2)
    C[:, 1:, len(given) :] = by_com.reshape(len(B), 3, -1)
    return np.einsum("nij,njk->ik", K, C)
