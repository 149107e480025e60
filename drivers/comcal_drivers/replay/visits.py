# SPDX-License-Identifier: Apache-2.0
"""Where in a log the robot stood: one pass over its joint positions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.measure.source import Block
from comcal.robot.tree import Array

LONGEST_ABSENCE = 0.5
"""A robot that is away from a place for no longer than this [s] has not left it: encoders flicker
about the limit, samples get lost."""
_SAME = 1e-9
"""Distances that differ by less [rad] or [m] are equal: a place visited under two numbers."""


@dataclass(frozen=True)
class Visit:
    """The robot stood within reach of a place, from ``start`` to ``end`` [s].

    Parameters
    ----------
    start, end : float
        Times of the first and of the last sample there [s].
    """

    start: float
    end: float

    @property
    def seconds(self) -> float:
        """How long it lasted [s]."""
        return self.end - self.start


@dataclass(frozen=True)
class Approach:
    """How near the robot ever came to a place.

    Parameters
    ----------
    distance : float
        Of the joint that was farthest off [rad] or [m]; infinite where no sample was finite.
    t : float
        When [s].
    joint : int
        Which joint that was.
    """

    distance: float = np.inf
    t: float = np.nan
    joint: int = -1


@dataclass(frozen=True)
class Visits:
    """What one pass over a log found, by place.

    Parameters
    ----------
    by_place : tuple of tuple of Visit
        In the order of time, long and short ones.
    nearest : tuple of Approach
        Of each place.
    start, end : float
        First and last sample of the log [s]; NaN where it is empty.
    samples, unknown : int
        In the log, and those of them whose joint positions are not all finite.
    """

    by_place: tuple[tuple[Visit, ...], ...]
    nearest: tuple[Approach, ...]
    start: float
    end: float
    samples: int
    unknown: int


def find_visits(blocks: Iterable[Block], places: Array, arrival: float) -> Visits:
    """Find every stay of the robot at some places.

    A sample belongs to the nearest place, if that is within reach: poses that are closer to one
    another than *arrival*, such as two tilts of one shape, are told apart.

    Parameters
    ----------
    blocks : iterable of Block
        The log, in order; however it is cut, the visits are the same.
    places : array, shape (n_places, n_joints)
        Joint positions [rad] or [m], each place once.
    arrival : float
        Largest distance of every joint from a place [rad] or [m].

    Returns
    -------
    Visits
    """
    found: list[list[Visit]] = [[] for _ in places]
    nearest = [Approach() for _ in places]
    start = end = np.nan
    samples = unknown = 0
    for block in blocks:
        if block.t.size == 0:
            continue
        start = float(block.t[0]) if np.isnan(start) else start
        end = float(block.t[-1])
        finite = np.isfinite(block.q).all(axis=1)
        samples += block.t.size
        unknown += int(np.count_nonzero(~finite))
        t, q = block.t[finite], block.q[finite]
        if t.size == 0 or len(places) == 0:
            continue
        distance, joint = _distances(q, places)
        _keep_nearest(nearest, t, distance, joint)
        inside = (distance <= arrival) & (distance <= distance.min(axis=1, keepdims=True) + _SAME)
        for place in np.flatnonzero(inside.any(axis=0)):
            _extend(found[place], t[inside[:, place]])
    return Visits(tuple(map(tuple, found)), tuple(nearest), start, end, samples, unknown)


def _distances(q: Array, places: Array) -> tuple[Array, npt.NDArray[np.intp]]:
    """Return the distance of the farthest joint, and which one, each shape (n, n_places)."""
    largest = np.zeros((len(q), len(places)))
    which = np.zeros(largest.shape, dtype=np.intp)
    for k in range(q.shape[1]):  # joint by joint: an array (n, n_places, n_joints) may be huge
        off = np.abs(q[:, k, None] - places[None, :, k])
        farther = off > largest
        largest[farther] = off[farther]
        which[farther] = k
    return largest, which


def _keep_nearest(
    nearest: list[Approach], t: Array, distance: Array, joint: npt.NDArray[np.intp]
) -> None:
    for place, row in enumerate(distance.argmin(axis=0)):
        here = float(distance[row, place])
        if here < nearest[place].distance:
            nearest[place] = Approach(here, float(t[row]), int(joint[row, place]))


def _extend(visits: list[Visit], t: Array) -> None:
    """Add the times *t* at which the robot was at a place to its visits."""
    breaks = np.flatnonzero(np.diff(t) > LONGEST_ABSENCE) + 1
    for stay in np.split(t, breaks):
        first, last = float(stay[0]), float(stay[-1])
        if visits and first - visits[-1].end <= LONGEST_ABSENCE:
            visits[-1] = Visit(visits[-1].start, last)
        else:
            visits.append(Visit(first, last))
