# SPDX-License-Identifier: Apache-2.0
r"""What static poses determine however the mass is split over the links.

The first moment of all carried links about the root origin is
:math:`\sum_k R_k (h_k + \sum_j M_j r_j)`, j the links that hang on link k at the points r_j of
link k, M_j the mass of all that hangs there: the constant vectors of Cotton 2008 times the mass.
A fit of the h_k alone, with the masses of the URDF, therefore determines the sums in brackets,
whatever the masses are; where a joint slides, only for the URDF's mass beyond it.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from comcal.identify.adjust import Adjustment
from comcal.identify.words import Combination
from comcal.robot.model import Robot
from comcal.robot.tree import Array

SHOWN = 0.02
"""Coefficients below this share of the largest are counted but not spelled out."""


def hung_moments(robot: Robot) -> Array:
    """Return the first moment of what hangs on each link, as points at its joints.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    array, shape (n_links, 3)
        In the link frame, with the URDF's masses [kg m].
    """
    tree = robot.tree
    beyond = tree.descendants @ tree.masses
    hung = np.zeros((len(tree.links), 3))
    for k, joint in enumerate(tree.joints, start=1):
        hung[tree.parents[k]] += beyond[k] * joint.T_parent_joint[:3, 3]
    return hung


def determined_sums(fit: Adjustment) -> tuple[Combination, ...]:
    """Return as many combinations as the poses determine, in no need of link masses.

    Parameters
    ----------
    fit : Adjustment

    Returns
    -------
    tuple of Combination
        The mass, and sums of first moments with what hangs on each link counted in: each has one
        component, the best seen ones, for itself. Values belong to all coefficients, the small
        ones that the words leave out included.
    """
    unknowns = fit.unknowns
    hung = hung_moments(unknowns.robot)[list(unknowns.links)]
    theta = fit.theta + np.concatenate([[0.0], hung.ravel()])
    pivots = np.asarray(qr(fit.seen.T, mode="r", pivoting=True)[-1], np.intp)
    own = np.sort(pivots[: fit.rank])
    rows = np.linalg.solve(fit.seen.T[:, own], fit.seen.T) / unknowns.scale
    rows *= unknowns.scale[own, None]
    return tuple(
        Combination(
            words=_words(unknowns.names, row),
            coefficients={n: float(c) for n, c in zip(unknowns.names, row, strict=True) if c},
            value=float(row @ theta),
            sigma=float(np.sqrt(row @ fit.cov @ row)),
        )
        for row in rows
    )


def _words(names: tuple[str, ...], row: Array) -> str:
    least = SHOWN * float(np.max(np.abs(row)))
    text = ""
    for name, c in zip(names, row, strict=True):
        if abs(c) >= least:
            sign = (" - " if c < 0 else " + ") if text else ("-" if c < 0 else "")
            factor = f"{abs(c):.2g} "
            text += sign + ("" if factor == "1 " else factor) + name
    return text
