# SPDX-License-Identifier: Apache-2.0
"""Readings with every mistake of wiring undone, one at a time: how near each is to the model.

All of them are evaluated in one go. What the best one is weighed against is what ordinary faults do
about the readings expected in its poses, which wiring of encoders and IMU changes, else nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.diagnose.mistakes_spread import SIGMAS, Ordinary, ordinary
from comcal.diagnose.readings import stacked, with_readings
from comcal.effects.mistakes import scaled_readings
from comcal.effects.registry import corrected
from comcal.measure.plan import NONE
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.robot.changes import Change
from comcal.robot.tree import Array

TAIL = 3.0
"""Degrees of freedom of the first glance, which no single wild row decides."""
MOST_APART = 6
"""Poses in which a hand, say, may have touched the robot."""
ELSEWHERE = 10.0
"""Log odds against that in one pose."""
G_ERROR = 0.03
"""Relative error of the length of what an IMU reads."""


@dataclass(frozen=True)
class Surroundings:
    """What ordinary faults do about the readings expected in the poses of a table.

    Parameters
    ----------
    table : PoseTable
    ordinary : Ordinary
    """

    table: PoseTable
    ordinary: Ordinary

    def hold_for(self, table: PoseTable) -> bool:
        """Return whether another table has the same poses, and readings of the same channels."""
        hangs = np.array([support == NONE for support in table.support], np.bool_)
        return (
            np.array_equal(self.table.q, table.q)
            and np.array_equal(self.table.imu[hangs], table.imu[hangs], equal_nan=True)
            and np.array_equal(np.isnan(stacked(self.table)), np.isnan(stacked(table)))
        )


def surroundings(
    assumed: Assumed, table: PoseTable, known: Surroundings | None = None
) -> Surroundings:
    """Return the surroundings of *table*: those that are known, if they hold for it."""
    if known is not None and known.hold_for(table):
        return known
    return Surroundings(table, ordinary(assumed, table))


@dataclass(frozen=True)
class Attempts:
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

    def at_a_glance(self, at: Ordinary) -> Array:
        """Return a score of every attempt, row by row, shape (1 + number,)."""
        rows = (self.residuals / at.calm[:, None]) ** 2
        rows = np.vstack([rows, self.lengths**2])
        rows = rows[np.isfinite(rows[:, 0])]
        score = -0.5 * (TAIL + 1.0) * np.log1p(rows / TAIL).sum(axis=0)
        return np.where(np.isfinite(score), score, -np.inf)

    def scores(self, at: Ordinary) -> tuple[Array, Array]:
        """Return the log likelihood of every attempt, and what ordinary faults leave of it."""
        used = np.isfinite(self.residuals[:, 0])
        chi2 = at.distances(self.residuals) + self.lengths**2
        chi2[~np.isfinite(self.residuals[used]).all(axis=0)] = np.inf
        return -0.5 * chi2 + self.prior, np.maximum(chi2 - float(used.sum()), 0.0)

    def score_apart(self, k: int, at: Ordinary) -> float:
        """Return the log likelihood of one attempt if something else happened in a few poses."""
        poses = len(self.tables[k])
        price = float(np.isfinite(self.residuals[:, 0]).sum()) / poses + 2.0 * ELSEWHERE
        residuals = np.where(np.isfinite(self.residuals[:, 0]), self.residuals[:, k], np.nan)
        chi2, apart = at.apart(residuals, min(MOST_APART, poses // 4), price)
        chi2 += float(self.lengths[k] ** 2) + price * apart
        return -0.5 * chi2 + float(self.prior[k])


def attempts(assumed: Assumed, table: PoseTable, tried: Sequence[Change]) -> Attempts:
    """Undo each of the mistakes *tried* by itself."""
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
    return Attempts(tables, residuals, lengths, np.array([0.0, *prior]))


def is_calm(assumed: Assumed, table: PoseTable, at: Ordinary) -> bool:
    """Return whether the readings are those of a healthy robot, as far as one may stray."""
    residuals = parity(assumed, table).values
    return _rows_are_calm(at, residuals) and abs(_length(assumed, table)) < SIGMAS


def _rows_are_calm(at: Ordinary, residuals: Array) -> bool:
    """Whether no kind of row strays further than those of a healthy robot, over all poses."""
    kinds: dict[object, list[float]] = {}
    for value, row in zip(residuals / at.calm, at.linear.at.row, strict=True):
        if np.isfinite(value):
            kinds.setdefault(row, []).append(float(value) ** 2)
    return all(np.mean(values) < 1.0 for values in kinds.values())


def _length(assumed: Assumed, table: PoseTable) -> float:
    """Return how far the length of the IMU's reading is from gravity, in deviations."""
    length = np.linalg.norm(table.imu, axis=1)
    length = length[np.isfinite(length)]
    if not length.size:
        return 0.0
    return (float(np.median(length)) / assumed.robot.gravity - 1.0) / G_ERROR
