# SPDX-License-Identifier: Apache-2.0
"""In words: what the poses determine, what they do not, and the pose that would show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.adjust import Adjustment
from comcal.identify.linearise import Group, regressor
from comcal.identify.unknowns import Unknowns
from comcal.robot.frames import apply, rotation_about
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at
from comcal.statics.configurations import foot_side_links
from comcal.statics.support import Carrier, carrier_of

SMALL_SHARE = 0.1
"""In scaled unknowns, parts of a direction below this share of its largest may be noise ..."""
SMALL_COEFFICIENT = 0.02
"""... and are, when their plain coefficient against that of the largest part is below this."""
SHOWN = 0.01
"""A trial pose shows a direction when its rows react to it with this share of their size."""
TRIAL_BEND = 0.5
"""Angle by which a trial pose bends one joint [rad], or metres by which it moves a slide."""
TRIAL_SLOPE = 0.2
"""Slope of a trial pose [rad]."""


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
        [kg m], or [kg] for the mass.
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
                sigma=float(np.sqrt(row @ adjustment.cov @ row)),
            )
        )
    return tuple(found)


def unseen_directions(adjustment: Adjustment) -> tuple[Unseen, ...]:
    """Return every direction the poses do not determine, with the pose that would show it."""
    unknowns = adjustment.unknowns
    order = list(range(unknowns.size))[::-1]
    found: list[Unseen] = []
    for row in _eliminate(adjustment.unseen.T, order):
        row = np.where(np.abs(row) < SMALL_SHARE * np.max(np.abs(row)), 0.0, row)
        parts = [unknowns.names[i] for i in np.flatnonzero(row)]
        if len(parts) == 1:
            words = f"{parts[0]} is not seen at all"
        else:
            words = f"{' against '.join(parts)}: they change together unnoticed"
        found.append(Unseen(words, _remedy(adjustment, row * unknowns.scale), tuple(parts)))
    return tuple(found)


def _eliminate(rows: Array, order: range | list[int]) -> Array:
    """Bring *rows* to reduced echelon form, taking pivot columns in *order* where they are fit."""
    rows = rows.copy()
    pivot = 0
    for column in order:
        if pivot == len(rows):
            break
        best = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[best, column]) < SMALL_SHARE:
            continue
        rows[[pivot, best]] = rows[[best, pivot]]
        rows[pivot] /= rows[pivot, column]
        others = np.arange(len(rows)) != pivot
        rows[others] -= np.outer(rows[others, column], rows[pivot])
        pivot += 1
    return rows[:pivot]


def _sum_in_words(unknowns: Unknowns, row: Array) -> str:
    text = ""
    for name, c in zip(unknowns.names, row, strict=True):
        if c:
            sign = "-" if c < 0 else "+"
            factor = "" if abs(abs(c) - 1.0) < 0.005 else f"{abs(c):.3g} "
            text += f" {sign} {factor}{name}" if text else f"{'-' if c < 0 else ''}{factor}{name}"
    return text


def _remedy(adjustment: Adjustment, direction: Array) -> str:
    """Try poses on the regressor until one of them shows *direction*.

    A direction made of standing feet only is tried on a slope first: no bent joint moves them.
    """
    robot = adjustment.unknowns.robot
    group = adjustment.groups[0]
    side = foot_side_links(robot, group.carrier)
    touched = {(i - 1) // 3 for i in np.flatnonzero(direction) if i > 0}
    only_feet = all(side[adjustment.unknowns.links[k]] for k in touched)
    trials = [_bent_joint, _other_foot, _slope]
    for trial in trials[::-1] if only_feet else trials:
        words = trial(adjustment, group, direction)
        if words:
            return words
    return "no pose shows it: it is merged along joint axes; fill it from CAD if it is needed"


def _bent_joint(adjustment: Adjustment, group: Group, direction: Array) -> str:
    up = _up(adjustment, group)
    for k, name in enumerate(adjustment.unknowns.robot.tree.joint_names):
        moved = group.q[:1].copy()
        moved[0, k] += TRIAL_BEND
        if _shows(adjustment, group.carrier, moved, up, direction):
            return f"a pose that moves {name} by itself would show it"
    return ""


def _other_foot(adjustment: Adjustment, group: Group, direction: Array) -> str:
    robot = adjustment.unknowns.robot
    measured = {g.carrier.support for g in adjustment.groups}
    for foot in robot.feet if len(robot.feet) > 1 else ():
        if foot not in measured:
            carrier = carrier_of(robot, foot)
            if _shows(adjustment, carrier, group.q[:1], _up(adjustment, group), direction):
                return f"a pose standing on the {foot} foot would show it"
    return ""


def _slope(adjustment: Adjustment, group: Group, direction: Array) -> str:
    for axis in np.eye(3):
        lean = apply(rotation_about(axis, TRIAL_SLOPE), _up(adjustment, group))
        if _shows(adjustment, group.carrier, group.q[:1], lean, direction):
            return "a pose on a slope would show it"
    return ""


def _up(adjustment: Adjustment, group: Group) -> Array:
    """Return the direction of the ground reaction in the first pose, root frame, shape (1, 3)."""
    robot = adjustment.unknowns.robot
    return balance_at(robot, group.carrier, group.q[:1], group.w[:1]).direction


def _shows(adjustment: Adjustment, carrier: Carrier, q: Array, up: Array, direction: Array) -> bool:
    """Return whether the rows of a trial pose react to a direction of the unknowns."""
    unknowns = adjustment.unknowns
    balance = balance_at(unknowns.robot, carrier, q, np.ones((1, len(carrier.sensors), 6)))
    columns = regressor(balance, unknowns, up) * direction
    return bool(np.linalg.norm(columns.sum(axis=-1)) > SHOWN * np.linalg.norm(columns))
