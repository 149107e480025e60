# SPDX-License-Identifier: Apache-2.0
"""In words: what the poses determine, what they do not, and the pose that would show it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.linearise import Group, regressor
from comcal.identify.unknowns import Unknowns
from comcal.robot.frames import apply, rotation_about
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at
from comcal.statics.configurations import foot_side_links
from comcal.statics.stance import stance_frame
from comcal.statics.support import Carrier, carrier_of

SMALL_SHARE = 0.1
"""In scaled unknowns, parts of a direction below this share of its largest may be noise ..."""
SMALL_COEFFICIENT = 0.02
"""... and are, when their plain coefficient against that of the largest part is below this."""
SHOWN = 0.01
"""A trial pose shows a direction when it reacts to it with this share of what it could, ..."""
MORE_THAN_BEFORE = 3.0
"""... and by this factor more than the poses there are, which react to it by noise."""
BENT_TOGETHER = 4
"""Trial poses in which all joints are bent."""
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
    """Return every direction the poses do not determine, with the pose that would show it."""
    unknowns = adjustment.unknowns
    if not adjustment.unseen.size:
        return ()
    order = list(range(unknowns.size))[::-1]
    trials = _Trials.of(adjustment)
    found: list[Unseen] = []
    for row in _eliminate(adjustment.unseen.T, order):
        large = np.abs(row) >= SMALL_SHARE * np.max(np.abs(row))
        parts = [unknowns.names[i] for i in np.flatnonzero(large)]
        if len(parts) == 1:
            words = f"{parts[0]} is not seen at all"
        else:
            words = f"{' against '.join(parts)}: they change together unnoticed"
        remedy = trials.remedy(row * unknowns.scale, large)
        found.append(Unseen(words, remedy, tuple(parts)))
    return tuple(found)


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
    for name, c in zip(unknowns.names, row, strict=True):
        if c:
            sign = "-" if c < 0 else "+"
            factor = "" if abs(abs(c) - 1.0) < 0.005 else f"{abs(c):.3g} "
            text += f" {sign} {factor}{name}" if text else f"{'-' if c < 0 else ''}{factor}{name}"
    return text


@dataclass(frozen=True)
class _Trials:
    """Poses that might show something, by what they do to the rows.

    Parameters
    ----------
    of_feet : array of bool, shape (size,)
        Unknowns of links on the feet's side of the standing ankles.
    session : array, shape (N, 4, size)
        Regressor of the poses there are.
    bends, others : list of (words, array of shape (4, size))
        One joint bent; the other foot.
    slopes, together : list of (words, array of shape (4, size))
        The first pose on slopes; all joints bent, on slopes.
    """

    gravity: float
    of_feet: npt.NDArray[np.bool_]
    session: Array
    bends: list[tuple[str, Array]]
    others: list[tuple[str, Array]]
    slopes: list[tuple[str, Array]]
    together: list[tuple[str, Array]]

    @classmethod
    def of(cls, adjustment: Adjustment) -> _Trials:
        """Compute them around the poses of a session."""
        unknowns, groups = adjustment.unknowns, adjustment.groups
        robot, first = unknowns.robot, groups[0]
        balances = [balance_at(robot, g.carrier, g.q, g.w) for g in groups]
        session = [regressor(balance, unknowns, balance.direction) for balance in balances]
        R, _ = stance_frame(robot, first.carrier.support, balances[0].placements)
        up = R[0].T @ balances[0].direction[0]

        def rows(carrier: Carrier, q: Array, up_in_P: Array) -> Array:
            unloaded = np.ones((1, len(carrier.sensors), 6))
            balance = balance_at(robot, carrier, q[None], unloaded)
            R, _ = stance_frame(robot, carrier.support, balance.placements)
            return regressor(balance, unknowns, apply(R, up_in_P))[0]

        n_joints = first.q.shape[1]
        bends = [
            (f"a pose that moves {name} by itself", rows(first.carrier, first.q[0] + bend, up))
            for name, bend in zip(
                robot.tree.joint_names, TRIAL_BEND * np.eye(n_joints), strict=True
            )
        ]
        others = [
            (f"a pose standing on the {carrier.support} foot", rows(carrier, first.q[0], up))
            for carrier in _other_carriers(robot, groups)
        ]
        leans = [rotation_about(axis, TRIAL_SLOPE) @ up for axis in np.eye(3)[:2]]
        slopes = [("a pose on a slope", rows(first.carrier, first.q[0], lean)) for lean in leans]
        together = [
            (
                "a pose that moves several joints, on a slope,",
                rows(
                    group.carrier,
                    group.q[0] + TRIAL_BEND * np.cos(k * (1.0 + np.arange(n_joints))),
                    leans[k % 2],
                ),
            )
            for group in groups
            for k in range(1, BENT_TOGETHER + 1)
        ]
        side = foot_side_links(robot, first.carrier)[list(unknowns.links)]
        of_feet = np.concatenate([[False], np.repeat(side, 3)])
        gravity = robot.gravity
        return cls(gravity, of_feet, np.concatenate(session), bends, others, slopes, together)

    def remedy(self, direction: Array, large: npt.NDArray[np.bool_]) -> str:
        """Return the first pose that shows a direction.

        One made of standing feet only is tried on a slope first: no bent joint moves them.

        Parameters
        ----------
        direction : array, shape (size,)
            Change of the unknowns.
        large : array of bool, shape (size,)
            Which of them take part by more than noise.
        """
        in_session = max(self._reaction(rows, direction) for rows in self.session)
        first = self.slopes if bool(np.all(self.of_feet[large])) else []
        for words, rows in (*first, *self.bends, *self.others, *self.slopes, *self.together):
            shown = self._reaction(rows, direction)
            if shown > max(SHOWN, MORE_THAN_BEFORE * in_session):
                return f"{words} would show it"
        return "no pose shows it: it is merged along joint axes; fill it from CAD if it is needed"

    def _reaction(self, rows: Array, direction: Array) -> float:
        """Return a pose's reaction as a share of what the parts would add up to, if they did."""
        whole = self.gravity * np.linalg.norm(direction)
        return float(np.linalg.norm(rows @ direction) / whole)


def _other_carriers(robot: Robot, groups: Sequence[Group]) -> Iterator[Carrier]:
    """Yield what carries the robot on each foot on which it has not stood alone."""
    measured = {group.carrier.support for group in groups}
    for foot in robot.feet if len(robot.feet) > 1 else ():
        if foot in measured:
            continue
        try:
            yield carrier_of(robot, foot)
        except ConfigError:  # nothing measures what this foot carries
            continue
