# SPDX-License-Identifier: Apache-2.0
"""All candidates side by side: one vector of coordinates, what is healthy and what a fault."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.diagnose.candidates import Candidate
from comcal.diagnose.linear import Linear
from comcal.robot.changes import ALL, spec_of
from comcal.robot.healthy import healthy_spreads
from comcal.robot.model import Robot
from comcal.robot.tree import Array

Coordinate = tuple[str, str, str]
"""Effect, target and key."""


@dataclass(frozen=True)
class Catalogue:
    """Candidates and their p coordinates.

    Parameters
    ----------
    candidates : tuple of Candidate
    fault : array, shape (p,)
        Size of a fault.
    healthy : array, shape (p,)
        Standard deviation of a healthy robot, as stated; 0 where nothing but a fault can be.
    family : tuple of str, length p
        Of ``tolerances``; empty where nothing is healthy.
    positive, required : array of bool, shape (p,)
        Coordinates that cannot be negative; and those without which there is no cause.
    open : array of bool, shape (n_candidates,)
        Whether it may be a fault; else it only has its healthy spread.
    """

    candidates: tuple[Candidate, ...]
    fault: Array
    healthy: Array
    family: tuple[str, ...]
    positive: npt.NDArray[np.bool_]
    required: npt.NDArray[np.bool_]
    open: npt.NDArray[np.bool_]

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where the coordinates of each candidate are."""
        ends = np.cumsum([len(c.keys) for c in self.candidates])
        return tuple(
            slice(int(end) - len(c.keys), int(end))
            for c, end in zip(self.candidates, ends, strict=True)
        )

    @cached_property
    def by_size(self) -> tuple[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]], ...]:
        """Candidates with k coordinates each: their numbers (c,), their coordinates (c, k)."""
        groups: dict[int, list[int]] = {}
        for i, candidate in enumerate(self.candidates):
            groups.setdefault(len(candidate.keys), []).append(i)
        return tuple(
            (
                np.array(numbers, np.intp),
                np.array([np.arange(self.slices[i].start, self.slices[i].stop) for i in numbers]),
            )
            for numbers in groups.values()
        )

    @cached_property
    def log_prior(self) -> Array:
        """Of each candidate, shape (n_candidates,)."""
        return np.array([c.log_prior for c in self.candidates], np.float64)

    @cached_property
    def index(self) -> Mapping[str, int]:
        """Number of every candidate by its name."""
        return {c.name: i for i, c in enumerate(self.candidates)}

    def spread(self, scales: Mapping[str, float], causes: Sequence[int] = ()) -> Array:
        """Return a standard deviation of every coordinate, shape (p,).

        Parameters
        ----------
        scales : mapping from family to float
            Factors on what is stated to be healthy.
        causes : sequence of int
            Candidates that are there: they may be as large as a fault.
        """
        found = self.healthy * np.array([scales.get(f, 1.0) for f in self.family])
        for i in causes:
            part = self.slices[i]
            found[part] = np.hypot(found[part], self.fault[part])
        return found

    def columns(self, at: Linear) -> Array:
        """Return what each coordinate adds to the residuals, shape (n, p)."""
        blocks = [candidate.columns(at) for candidate in self.candidates]
        return np.concatenate(blocks, axis=1) if blocks else np.zeros((len(at.at.values), 0))


def catalogue(
    candidates: Sequence[Candidate],
    robot: Robot,
    looked_for: Container[str] | None = None,
    also: Mapping[Coordinate, float] | None = None,
) -> Catalogue:
    """Put candidates side by side.

    Parameters
    ----------
    candidates : sequence of Candidate
    robot : Robot
        Whose tolerances count.
    looked_for : container of str, optional
        Effects that may be faults; others only have their healthy spread. Default: all.
    also : mapping from (effect, target, key) to float, optional
        Standard deviations of what may be there beside the healthy spread.
    """
    spreads = healthy_spreads(robot)
    fault: list[float] = []
    healthy: list[float] = []
    family: list[str] = []
    positive: list[bool] = []
    required: list[bool] = []
    for candidate in candidates:
        keys = spec_of(candidate.effect.name).keys
        for key, size in zip(candidate.keys, candidate.fault.tolist(), strict=True):
            of = "" if candidate.target == ALL else candidate.effect.family.get(key, "")
            scale = _mass(robot, candidate.target) if of == "link_mass" else 1.0
            fault.append(size)
            family.append(of)
            spread = scale * spreads.get(of, 0.0) if of else 0.0
            more = (also or {}).get((candidate.effect.name, candidate.target, key), 0.0)
            healthy.append(float(np.hypot(spread, more)))
            known = keys.get(key)  # a free couple has no key
            bounded = known is not None and known.least == 0.0
            positive.append(bounded and key not in candidate.effect.moments)
            required.append(bounded and known is not None and known.required)
    return Catalogue(
        tuple(candidates),
        np.array(fault, np.float64),
        np.array(healthy, np.float64),
        tuple(family),
        np.array(positive, np.bool_),
        np.array(required, np.bool_),
        np.array([looked_for is None or c.effect.name in looked_for for c in candidates], np.bool_),
    )


def _mass(robot: Robot, link: str) -> float:
    return robot.tree.links[robot.tree.link_index[link]].mass
