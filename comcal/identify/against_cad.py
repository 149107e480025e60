# SPDX-License-Identifier: Apache-2.0
r"""What the data say about the unknowns, in coordinates in which CAD says the same about each.

``tolerances`` make the URDF a Gaussian: the mass of a link and its CoM are each off by so much,
independently. With P a root of that covariance, :math:`\theta = \theta_{CAD} + P\,x` has unit
variance in every component of x. The data are the fitted values along the seen directions,

.. math:: d = U^T S^{-1} (\theta_{fit} - \theta_{CAD}), \qquad d \sim N(U^T S^{-1} P\,x,\; D)

with S the scale of the unknowns, U the seen directions, and D what the measurement noise, the tares
and the errors of the links below the cuts make of them. A singular value decomposition of
:math:`D^{-1/2} U^T S^{-1} P` turns both into one number per direction:
:math:`y_i \sim N(s_i w_i, 1)` and :math:`w_i \sim N(0, 1)`. Directions that no pose shows have
no y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.unknowns import Unknowns
from comcal.robot.tree import Array


@dataclass(frozen=True)
class AgainstCad:
    """A fit as independent directions: theta = CAD + basis w.

    Parameters
    ----------
    basis : array, shape (size, size)
        Change of the unknowns by one CAD sigma along each direction; those seen stand first.
    gain : array, shape (rank,)
        s: how many sigmas of the data one CAD sigma is.
    seen : array, shape (rank,)
        y: what was measured, in sigmas of the data away from CAD.
    """

    basis: Array
    gain: Array
    seen: Array

    @property
    def rank(self) -> int:
        """Number of directions that the poses determine."""
        return len(self.gain)


def against_cad(fit: Adjustment, root: Array) -> AgainstCad:
    """Return *fit* in the directions that belong to a covariance of CAD.

    Parameters
    ----------
    fit : Adjustment
    root : array, shape (size, size)
        P with covariance P P^T, as :func:`cad_root` makes it. Where it has no width, CAD is exact.
    """
    unknowns = fit.unknowns
    to_seen = fit.seen.T / unknowns.scale
    cov = to_seen @ (fit.cov + cad_inputs(fit).cov) @ to_seen.T
    half = np.linalg.cholesky(0.5 * (cov + cov.T))
    d = np.linalg.solve(half, to_seen @ (fit.theta - unknowns.cad))
    U, gain, Vt = np.linalg.svd(np.linalg.solve(half, to_seen @ root))
    return AgainstCad(basis=root @ Vt.T, gain=gain, seen=U.T @ d)


def cad_root(unknowns: Unknowns, strength: float = 1.0, smallest: float = 0.0) -> Array:
    """Return a root of the covariance of what the URDF says, shape (size, size).

    Parameters
    ----------
    unknowns : Unknowns
    strength : float
        Divides the sigmas of ``tolerances``. Those of tares, about which robot.yaml says nothing,
        only grow: more trust in CAD is none in a sensor.
    smallest : float
        Least sigma, as a share of the scale of each unknown, before it is divided.

    Notes
    -----
    Where masses are free, one that is off by dm takes the first moment along by c dm: it is the CoM
    that ``tolerances.link_com`` is about.
    """
    sigma = np.maximum(unknowns.cad_sigma, smallest * unknowns.scale)
    offsets = slice(unknowns.first_offset, unknowns.size)
    sigma[: offsets.start] /= strength
    sigma[offsets] /= min(strength, 1.0)
    root = np.diag(sigma)
    for k in unknowns.links:
        mass, column = unknowns.mass_column(k), unknowns.column(k)
        if mass is not None and column is not None:
            root[column : column + 3, mass] = unknowns.robot.tree.coms[k] * sigma[mass]
    return root
