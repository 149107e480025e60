# SPDX-License-Identifier: Apache-2.0
"""Where a link is in P."""

from __future__ import annotations

import numpy as np

from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.standing import standing_at
from comcal.robot.frames import apply
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array
from comcal.statics.support import carrier_of


def first_place(assumed: Assumed, table: PoseTable, link: int) -> Array:
    """Return the origin of a link in P in the first pose that stands, shape (3,) [m].

    Zero where no pose stands.
    """
    first = next((i for i, support in enumerate(table.support) if support != NONE), None)
    if first is None:
        return np.zeros(3)
    part = table.select([first])
    at = place_links(assumed.robot.tree, part.q)
    standing = standing_at(assumed, part, carrier_of(assumed.robot, part.support[0]), at)
    return apply(standing.R_root_P[0].T, at.p[0, link] - standing.p_root_P[0])
