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

from comcal.diagnose.mistakes_candidates import mistakes
from comcal.diagnose.mistakes_spread import SIGMAS, Ordinary, ordinary
from comcal.diagnose.readings import stacked, with_readings
from comcal.effects.mistakes import scaled_readings
from comcal.effects.registry import corrected
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes import Change
from comcal.robot.tree import Array

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
MOST = 3
"""Mistakes that are undone one after the other."""
ROUNDS = 4
"""Best attempts whose poses are taken as the true ones, in search of one that stays the best."""
TAIL = 3.0
"""Degrees of freedom of the first glance, which no single wild row decides."""
POSES = 40
"""No more than this are looked at."""
G_ERROR = 0.03
"""Relative error of the length of what an IMU reads."""

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
        best = _best(assumed, _undone(assumed, part, found), tried)
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
    """

    change: Change
    log_odds: float
    rivals: Rivals
    left: float


def _undone(assumed: Assumed, table: PoseTable, found: Sequence[_Best]) -> PoseTable:
    return corrected(assumed, table, [one.change for one in found])[1]


def _in_place_of_one_another(
    assumed: Assumed, table: PoseTable, tried: Sequence[Change], found: list[_Best]
) -> list[_Best]:
    """Weigh each of several mistakes again with the others undone: one may have hidden another."""
    for k in range(len(found) if len(found) > 1 else 0):
        others = [*found[:k], *found[k + 1 :]]
        best = _best(assumed, _undone(assumed, table, others), tried)
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


@dataclass(frozen=True)
class _Attempts:
    """All mistakes undone, each by itself; the first attempt undoes nothing.

    Parameters
    ----------
    tables : tuple of PoseTable
    residuals : array, shape (n, 1 + number)
    lengths : array, shape (1 + number,)
        Of what the IMU reads, in deviations from gravity.
    prior : array, shape (1 + number,)
        Log of the density lost where readings are taken to be smaller than they say.
    """

    tables: tuple[PoseTable, ...]
    residuals: Array
    lengths: Array
    prior: Array


def _best(assumed: Assumed, table: PoseTable, tried: Sequence[Change]) -> _Best | None:
    """Return the best mistake, None where none says more than ordinary faults."""
    at = ordinary(assumed, table)
    given = parity(assumed, table).values
    if _is_calm(at, given) and abs(_length(assumed, table)) < SIGMAS:
        return None
    attempts = _attempts(assumed, table, tried)
    near = _at_a_glance(attempts, at)
    best = int(np.argmax(near))
    if near[best] < near[0] + PROMISING:
        return None
    scores = excess = near
    for _ in range(ROUNDS):
        if best and not _same_poses(attempts.tables[best], at.linear.table):
            at = ordinary(assumed, attempts.tables[best])
        scores, excess = _scores(attempts, at)
        before, best = best, int(np.argmax(scores))
        if best == before:
            break
    odds = float(scores[best] - scores[0]) - float(np.log(len(tried)))
    left = float(excess[best] / excess[0]) if excess[0] > 0.0 else 0.0
    if best == 0 or odds < ENOUGH or left > HALF:
        return None
    order = [int(i) for i in np.argsort(-scores, kind="stable") if i not in (0, best)]
    rivals = tuple(
        (tried[i - 1], float(scores[best] - scores[i]))
        for i in order
        if scores[best] - scores[i] <= EQUAL
    )
    return _Best(tried[best - 1], odds, rivals, left)


def _is_calm(at: Ordinary, residuals: Array) -> bool:
    """Whether no kind of row strays further than those of a healthy robot, over all poses."""
    kinds: dict[object, list[float]] = {}
    for value, row in zip(residuals / at.calm, at.linear.at.row, strict=True):
        if np.isfinite(value):
            kinds.setdefault(row, []).append(float(value) ** 2)
    return all(np.mean(values) < 1.0 for values in kinds.values())


def _attempts(assumed: Assumed, table: PoseTable, tried: Sequence[Change]) -> _Attempts:
    tables = (table, *(corrected(assumed, table, [change])[1] for change in tried))
    n = len(table)
    many = table.select(np.tile(np.arange(n), len(tables)))
    values = np.concatenate([stacked(one) for one in tables])
    found = parity(assumed, with_readings(many, values))
    residuals = found.values[np.argsort(found.pose // n, kind="stable")].reshape(len(tables), -1).T
    prior = [
        -scaled_readings(change, assumed.robot, table) * np.log(change.number("factor"))
        if change.number("factor") > 1.0
        else 0.0
        for change in tried
    ]
    lengths = np.array([_length(assumed, one) for one in tables])
    return _Attempts(tables, residuals, lengths, np.array([0.0, *prior]))


def _length(assumed: Assumed, table: PoseTable) -> float:
    """Return how far the length of the IMU's reading is from gravity, in deviations."""
    length = np.linalg.norm(table.imu, axis=1)
    length = length[np.isfinite(length)]
    if not length.size:
        return 0.0
    return (float(np.median(length)) / assumed.robot.gravity - 1.0) / G_ERROR


def _at_a_glance(attempts: _Attempts, at: Ordinary) -> Array:
    """Return a score of every attempt, row by row, shape (1 + number,)."""
    rows = (attempts.residuals / at.calm[:, None]) ** 2
    rows = np.vstack([rows, attempts.lengths**2])
    rows = rows[np.isfinite(rows[:, 0])]
    score = -0.5 * (TAIL + 1.0) * np.log1p(rows / TAIL).sum(axis=0)
    return np.where(np.isfinite(score), score, -np.inf)


def _scores(attempts: _Attempts, at: Ordinary) -> tuple[Array, Array]:
    """Return the log likelihood of every attempt, and what ordinary faults leave of it."""
    used = np.isfinite(attempts.residuals[:, 0])
    chi2 = at.distances(attempts.residuals) + attempts.lengths**2
    chi2[~np.isfinite(attempts.residuals[used]).all(axis=0)] = np.inf
    return -0.5 * chi2 + attempts.prior, np.maximum(chi2 - float(used.sum()), 0.0)


def _same_poses(a: PoseTable, b: PoseTable) -> bool:
    return np.array_equal(a.q, b.q) and a.imu is b.imu
