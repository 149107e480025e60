# SPDX-License-Identifier: Apache-2.0
"""Where links are in P."""

from __future__ import annotations

import numpy as np

from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.remembered import remembered
from comcal.predict.standing import standing_at
from comcal.robot.frames import apply
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array
from comcal.statics.support import carrier_of


def link_places(assumed: Assumed, table: PoseTable) -> Array:
    """Return the origins of all links in P, shape (N, n_links, 3) [m]; NaN of a hanging robot."""
    found = np.full((len(table), len(assumed.robot.tree.links), 3), np.nan)
    for support in sorted(set(table.support) - {NONE}):
        index = np.flatnonzero([s == support for s in table.support])
        part = table.select(index)
        at = place_links(assumed.robot.tree, part.q)
        standing = standing_at(assumed, part, carrier_of(assumed.robot, support), at)
        R_P_root = np.swapaxes(standing.R_root_P, 1, 2)
        found[index] = apply(R_P_root[:, None], at.p - standing.p_root_P[:, None])
    return found


def first_place(assumed: Assumed, table: PoseTable, link: int) -> Array:
    """Return the origin of a link in P in the first pose that stands, shape (3,) [m].

    Zero where no pose stands.
    """
    return _first_places(assumed, table)[link]


@remembered
def _first_places(assumed: Assumed, table: PoseTable) -> Array:
    """Return the origins of all links in P in the first pose that stands, (n_links, 3) [m]."""
    first = next((i for i, support in enumerate(table.support) if support != NONE), None)
    if first is None:
        return np.zeros((len(assumed.robot.tree.links), 3))
    return link_places(assumed, table.select([first]))[0]
