# SPDX-License-Identifier: Apache-2.0
"""Undo mistakes of wiring and configuration before anything else is weighed.

Every mistake is tried as it stands, all of them in one evaluation of the residuals. What counts is
how much nearer to the model the readings come than any ordinary fault could explain, measured by
one covariance about the readings that the model expects in the poses of the best attempt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.diagnose.mistakes_attempts import Surroundings, attempts, is_calm, surroundings
from comcal.diagnose.mistakes_candidates import mistakes
from comcal.effects.registry import corrected
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change

ENOUGH = 10.0
"""Log odds of a mistake against ordinary faults."""
PROMISING = 2.0
"""Nearer by less at a first glance, nothing is looked at closely."""
HALF = 0.5
"""Of what ordinary faults do not explain, a mistake leaves no more than this part ..."""
REST = 0.1
"""... and all mistakes together no more than this: else something else is wrong."""
EQUAL = 6.0
"""Other mistakes whose log odds are less by no more than this are rivals."""
SAME = 1e-6
"""Log odds of two that come to the same, but for rounding."""
MOST = 3
"""Mistakes that are undone one after the other."""
ROUNDS = 4
"""Best attempts whose poses are taken as the true ones, in search of one that stays the best."""
POSES = 40
"""No more than this are looked at."""

Rivals = tuple[tuple[Change, float], ...]


@dataclass(frozen=True)
class Mistake:
    """A mistake that was undone.

    Parameters
    ----------
    change : Change
    table : PoseTable
        The readings without it, and without those found before it.
    log_odds : float
        Against ordinary faults, with the number of mistakes tried taken off.
    rivals : tuple of (Change, float)
        Other mistakes that explain the readings as well, or nearly, with the log odds of this one
        against each; strongest first. 0: they come to the same.
    """

    change: Change
    table: PoseTable
    log_odds: float
    rivals: Rivals = ()


def screen_mistakes(assumed: Assumed, table: PoseTable, most: int = MOST) -> tuple[Mistake, ...]:
    """Find mistakes of wiring and configuration, the plainest first.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
    most : int
        Look for no more than this.

    Returns
    -------
    tuple of Mistake
        Empty when ordinary faults, or none, explain the readings; the table of the last one has
        all of them undone.
    """
    tried = mistakes(assumed.robot, table)
    part = _some(table)
    found: list[_Best] = []
    known, rest = 0, 1.0
    while tried and len(found) < most:
        about = found[-1].about if found else None
        best = _best(assumed, _undone(assumed, part, found), tried, about)
        if best is None:
            break
        found.append(best)
        rest *= best.left
        if rest <= REST:
            known = len(found)
    found = _in_place_of_one_another(assumed, part, tried, found[:known])
    return tuple(
        Mistake(one.change, _undone(assumed, table, found[: k + 1]), one.log_odds, one.rivals)
        for k, one in enumerate(found)
    )


@dataclass(frozen=True)
class _Best:
    """The best of all mistakes that were tried.

    Parameters
    ----------
    change, log_odds, rivals
        As of :class:`Mistake`.
    left : float
        Which part of what ordinary faults do not explain it leaves.
    about : Surroundings
        What it was weighed against.
    """

    change: Change
    log_odds: float
    rivals: Rivals
    left: float
    about: Surroundings


def _undone(assumed: Assumed, table: PoseTable, found: Sequence[_Best]) -> PoseTable:
    return corrected(assumed, table, [one.change for one in found])[1]


def _in_place_of_one_another(
    assumed: Assumed, table: PoseTable, tried: Sequence[Change], found: list[_Best]
) -> list[_Best]:
    """Weigh each of several mistakes again with the others undone: one may have hidden another."""
    for k in range(len(found) if len(found) > 1 else 0):
        others = [*found[:k], *found[k + 1 :]]
        best = _best(assumed, _undone(assumed, table, others), tried, found[k].about)
        if best is not None:
            found = [*found[:k], best, *found[k + 1 :]]
    return found


def _some(table: PoseTable) -> PoseTable:
    """Return poses enough to tell, spread over supports and time: a mistake is in all of them."""
    if len(table) <= POSES:
        return table
    by_support = sorted(range(len(table)), key=lambda i: table.support[i])
    chosen = np.linspace(0, len(table) - 1, POSES).round().astype(np.intp)
    return table.select(np.sort(np.array(by_support)[chosen]))


def _best(
    assumed: Assumed, table: PoseTable, tried: Sequence[Change], about: Surroundings | None
) -> _Best | None:
    """Return the best mistake, None where none says more than ordinary faults."""
    about = surroundings(assumed, table, about)
    if is_calm(assumed, table, about.ordinary):
        return None
    each = attempts(assumed, table, tried)
    near = each.at_a_glance(about.ordinary)
    best = int(np.argmax(near))
    if near[best] < near[0] + PROMISING:
        return None
    scores = excess = near
    for _ in range(ROUNDS):
        about = surroundings(assumed, each.tables[best], about)
        scores, excess = each.scores(about.ordinary)
        before, best = best, int(np.argmax(scores))
        if best == before:
            break
    odds = float(scores[best] - scores[0]) - float(np.log(len(tried)))
    left = float(excess[best] / excess[0]) if excess[0] > 0.0 else 0.0
    if best == 0 or odds < ENOUGH or left > HALF:
        return None
    # A few poses that even the mistake does not explain, such as those in which a hand touched the
    # robot, say nothing for it: they are set apart from both.
    apart = each.score_apart(best, about.ordinary) - each.score_apart(0, about.ordinary)
    if apart - float(np.log(len(tried))) < ENOUGH:
        return None
    order = [int(i) for i in np.argsort(-scores, kind="stable") if i not in (0, best)]
    behind = np.where(scores[best] - scores < SAME, 0.0, scores[best] - scores)
    rivals = tuple((tried[i - 1], float(behind[i])) for i in order if behind[i] <= EQUAL)
    return _Best(tried[best - 1], odds, rivals, left, about)
