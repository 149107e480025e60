# SPDX-License-Identifier: Apache-2.0
"""Results of the last few states: what hundreds of causes ask of one state is found once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import wraps

from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.tree import Array

KEPT = 4
"""States whose results are kept; whoever linearises about a state asks for it again and again."""

OfState = Callable[[Assumed, PoseTable], Array]


def remembered(function: OfState) -> OfState:
    """Return a pure function of a state that keeps its newest results, marked read-only.

    States are told apart as objects: they are frozen, and comparing arrays would cost more.
    """
    newest: deque[tuple[Assumed, PoseTable, Array]] = deque(maxlen=KEPT)

    @wraps(function)
    def found(assumed: Assumed, table: PoseTable) -> Array:
        for known, at, result in tuple(newest):
            if known is assumed and at is table:
                return result
        result = function(assumed, table)
        result.setflags(write=False)
        newest.append((assumed, table, result))
        return result

    return found
