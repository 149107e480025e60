# SPDX-License-Identifier: Apache-2.0
"""Which visit of the log is which pose of the plan.

Decided once for the whole plan and the whole log, so that a resumed recording takes the same
samples as one that was never interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from comcal_drivers.replay.visits import Visit


def assign_in_order(
    plan: Sequence[int], visits: Sequence[Sequence[Visit]]
) -> tuple[tuple[Visit, ...], ...]:
    """Give visits to poses so that both follow in the same order.

    As many poses as possible get one: a pose that the robot was never in, or visited at another
    time than planned, must not cost those after it.

    Parameters
    ----------
    plan : sequence of int
        The place of every pose, in the order of the plan.
    visits : sequence of sequence of Visit
        By place, in the order of time.

    Returns
    -------
    tuple of tuple of Visit
        For each pose the visits to try, one after the other; none for a pose left out.
    """
    stays = sorted(
        ((visit, place) for place, seen in enumerate(visits) for visit in seen),
        key=lambda stay: stay[0].start,
    )
    chosen = _longest_match(plan, [place for _, place in stays])
    taken = [k for k in chosen if k is not None]
    found: list[tuple[Visit, ...]] = []
    for place, k in zip(plan, chosen, strict=True):
        if k is None:
            found.append(())
            continue
        following = min((other for other in taken if other > k), default=len(stays))
        found.append(tuple(visit for visit, at in stays[k:following] if at == place))
    return tuple(found)


def assign_any_order(
    plan: Sequence[int], visits: Sequence[Sequence[Visit]]
) -> tuple[tuple[Visit, ...], ...]:
    """Give every pose the visits of its place, whenever they were.

    Several poses at one place get them in turn; what is left over is there for all of them to try.

    Parameters
    ----------
    plan : sequence of int
        The place of every pose, in the order of the plan.
    visits : sequence of sequence of Visit
        By place, in the order of time.

    Returns
    -------
    tuple of tuple of Visit
        For each pose the visits to try, one after the other.
    """
    found: list[tuple[Visit, ...]] = []
    for i, place in enumerate(plan):
        seen, rank, poses = visits[place], plan[:i].count(place), plan.count(place)
        found.append((*seen[rank : rank + 1], *seen[poses:]))
    return tuple(found)


def _longest_match(wanted: Sequence[int], seen: Sequence[int]) -> list[int | None]:
    """Return for each of *wanted* its index in *seen*, increasing, for as many as possible."""
    n, m = len(wanted), len(seen)
    best = np.zeros((n + 1, m + 1), dtype=np.int64)  # of wanted[i:] and seen[j:]
    places = np.asarray(seen, dtype=np.int64)
    for i in range(n - 1, -1, -1):
        matched = np.where(places == wanted[i], best[i + 1, 1:] + 1, 0)
        options = np.maximum(matched, best[i + 1, :-1])
        best[i, :-1] = np.maximum.accumulate(options[::-1])[::-1]
    found: list[int | None] = []
    j = 0
    for place, following in zip(wanted, best[1:], strict=True):
        # The earliest visit leaves most for the poses to come; is the pose worth it?
        k = next((k for k in range(j, m) if places[k] == place), None)
        if k is not None and following[k + 1] + 1 >= following[j]:
            j = k + 1
        else:
            k = None
        found.append(k)
    return found
