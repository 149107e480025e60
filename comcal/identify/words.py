# SPDX-License-Identifier: Apache-2.0
"""In words: what the poses determine, and what they do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.merged import CLEAR, Merged, merged_directions
from comcal.identify.remedies import Remedies
from comcal.identify.unknowns import Unknowns
from comcal.robot.tree import Array

SMALL_SHARE = 0.1
"""In scaled unknowns, parts of a direction below this share of its largest may be noise ..."""
SMALL_COEFFICIENT = 0.02
"""... and are, when their plain coefficient against that of the largest part is below this."""


MOST_PARTS = 8
"""Parts of a combination that are spelled out; its coefficients hold all."""
NEVER_SEEN = 0.02
"""Part of a direction among the seen ones, as noise turns them, that may be no more than noise."""


@dataclass(frozen=True)
class Combination:
    """A linear combination of the unknowns that the poses determine.

    Parameters
    ----------
    words : str
        Such as ``l_shin x + r_shin x``.
    coefficients : mapping
        By name of the unknown.
    value, sigma : float
        [kg m], or [kg] for the mass; sigma from noise and CAD, small parts left out included.
    """

    words: str
    coefficients: dict[str, float]
    value: float
    sigma: float


@dataclass(frozen=True)
class Unseen:
    """A direction in which the unknowns may move without any pose noticing.

    Parameters
    ----------
    words : str
        What trades against what.
    remedy : str
        The pose that would show it, or why none does.
    parts : tuple of str
        Names of the unknowns that take part.
    """

    words: str
    remedy: str
    parts: tuple[str, ...]


def combinations_of(adjustment: Adjustment) -> tuple[Combination, ...]:
    """Return independent combinations that span everything the poses determine.

    A component that is determined by itself stands alone. Found by elimination in tree order, so
    that what is merged is named by the link nearest to the root.
    """
    unknowns = adjustment.unknowns
    cov = adjustment.cov + adjustment.cov_cad + cad_inputs(adjustment).cov
    rows = _eliminate(adjustment.seen.T, range(unknowns.size)) / unknowns.scale
    found: list[Combination] = []
    for row in rows:
        largest = int(np.argmax(np.abs(row * unknowns.scale)))
        row = row / row[largest]
        small = np.abs(row * unknowns.scale) < SMALL_SHARE * unknowns.scale[largest]
        row[small & (np.abs(row) < SMALL_COEFFICIENT)] = 0.0
        found.append(
            Combination(
                words=_sum_in_words(unknowns, row),
                coefficients={n: float(c) for n, c in zip(unknowns.names, row, strict=True) if c},
                value=float(row @ adjustment.theta),
                sigma=float(np.sqrt(row @ cov @ row)),
            )
        )
    return tuple(found)


def unseen_directions(adjustment: Adjustment) -> tuple[Unseen, ...]:
    """Return every direction the poses do not determine, with the pose that would show it.

    First those that no pose whatever shows, because statics merges them at a joint.
    """
    unknowns = adjustment.unknowns
    if not adjustment.unseen.size:
        return ()
    order = list(range(unknowns.size))[::-1]
    merged, rest = _merged_and_rest(adjustment)
    found = [_merged_in_words(unknowns, m) for m in merged]
    if not rest.size:
        return tuple(found)
    remedies = Remedies.around(adjustment)
    for row in _eliminate(rest.T, order):
        large = np.abs(row) >= SMALL_SHARE * np.max(np.abs(row))
        parts = [unknowns.names[i] for i in np.flatnonzero(large)]
        if len(parts) == 1:
            words = f"{parts[0]} is not seen at all"
        else:
            words = f"{' against '.join(parts)}: they change together unnoticed"
        remedy = remedies.of_direction(row * unknowns.scale, large)
        found.append(Unseen(words, remedy, tuple(parts)))
    return tuple(found)


def _merged_and_rest(adjustment: Adjustment) -> tuple[list[Merged], Array]:
    """Split what is unseen into what statics never shows and the rest, scaled, (size, k)."""
    unseen, scale = adjustment.unseen, adjustment.unknowns.scale
    never: list[Merged] = []
    basis = np.zeros((len(scale), 0))
    for merged in merged_directions(adjustment.unknowns):
        unit = merged.direction / scale
        unit /= np.linalg.norm(unit)
        new = unit - basis @ (basis.T @ unit)
        if np.linalg.norm(adjustment.seen.T @ unit) < NEVER_SEEN and np.linalg.norm(new) > CLEAR:
            never.append(merged)
            basis = np.column_stack([basis, new / np.linalg.norm(new)])
    inside = unseen.T @ basis
    if basis.shape[1] == unseen.shape[1]:
        return never, unseen[:, :0]
    left = np.linalg.svd(inside, full_matrices=True)[0][:, basis.shape[1] :]
    return never, unseen @ left


def _merged_in_words(unknowns: Unknowns, merged: Merged) -> Unseen:
    size = np.abs(merged.direction / unknowns.scale)
    parts = tuple(unknowns.names[i] for i in np.flatnonzero(size > CLEAR * size.max()))
    words = f"{' against '.join(parts)}: they change together unnoticed"
    remedy = f"no pose shows it: {merged.why}; fill it from CAD if it is needed"
    return Unseen(words, remedy, parts)


def _eliminate(rows: Array, order: range | list[int]) -> Array:
    """Bring *rows* to reduced echelon form, taking pivot columns in *order* where they are fit.

    Rows in which no column is, take their largest.
    """
    rows = rows.copy()
    pivot = 0
    for column in order:
        if pivot == len(rows):
            break
        best = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[best, column]) >= SMALL_SHARE:
            _clear_column(rows, pivot, best, column)
            pivot += 1
    for left in range(pivot, len(rows)):
        best, column = np.unravel_index(int(np.argmax(np.abs(rows[left:]))), rows[left:].shape)
        _clear_column(rows, left, left + int(best), int(column))
    return rows


def _clear_column(rows: Array, pivot: int, best: int, column: int) -> None:
    """Swap row *best* to *pivot* and clear *column* from all the others, in place."""
    rows[[pivot, best]] = rows[[best, pivot]]
    rows[pivot] /= rows[pivot, column]
    others = np.arange(len(rows)) != pivot
    rows[others] -= np.outer(rows[others, column], rows[pivot])


def _sum_in_words(unknowns: Unknowns, row: Array) -> str:
    text = ""
    parts = np.flatnonzero(row)
    least = np.sort(np.abs(row * unknowns.scale)[parts])[::-1][:MOST_PARTS][-1]
    shown = [i for i in parts if abs(row[i] * unknowns.scale[i]) >= least]
    for name, c in ((unknowns.names[i], float(row[i])) for i in shown):
        sign = "-" if c < 0 else "+"
        factor = "" if abs(abs(c) - 1.0) < 0.005 else f"{abs(c):.3g} "
        text += f" {sign} {factor}{name}" if text else f"{'-' if c < 0 else ''}{factor}{name}"
    left = len(parts) - len(shown)
    return f"{text} and {left} smaller parts" if left else text
