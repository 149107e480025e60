# SPDX-License-Identifier: Apache-2.0
"""How far the CoM of a standing robot is inside the polygon of its soles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from comcal.robot.tree import Array


def support_margin(point: npt.ArrayLike, contacts: Array) -> float:
    """Return the distance of a point from the nearest edge of the support polygon.

    Parameters
    ----------
    point : array, shape (2,)
        Where the weight meets the floor [m].
    contacts : array, shape (n, 2)
        Points that touch the floor [m], at least three not on one line.

    Returns
    -------
    float
        [m]; negative outside.
    """
    # Each row of a hull's equations is an outward unit normal and an offset, n . x + d <= 0 inside.
    equations = ConvexHull(contacts).equations
    return float(-(equations[:, :2] @ np.asarray(point) + equations[:, 2]).max())
