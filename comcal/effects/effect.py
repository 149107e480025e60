# SPDX-License-Identifier: Apache-2.0
"""A named cause, as the diagnosis sees it.

An effect *corrects*: given what is assumed and what was read, and a change that is true of the
robot, it returns what is then assumed and what the readings then mean, so that their parity
residuals vanish where nothing else is wrong. Composed, corrections are the extended model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.robot.changes import Change

State = tuple[Assumed, PoseTable]
"""What is assumed, and the readings as they are then understood."""


class Stage(IntEnum):
    """When readings are corrected for an effect: against the order in which they came about.

    A current is scaled by its motor, then its sensor adds an offset: the offset is taken off first,
    whichever was found first. Springs and play give way to torques that need everything else. What
    was found later, of readings that were corrected, comes later.
    """

    WIRING = 0
    TIME = 1
    OFFSET = 2
    AXES = 3
    SCALE = 4
    ELSE = 5
    SPRING = 6


@dataclass(frozen=True)
class Effect:
    """One cause of the catalogue.

    Parameters
    ----------
    name : str
        As in :func:`comcal.robot.effect_specs.effect_specs`, which holds keys and units.
    correct : callable
        Takes what is assumed, the readings and a change; returns both corrected.
    fault : mapping from key to float
        Size of a fault worth looking for, one sigma, SI; of ``moments``, in kg m.
    family : mapping from key to str
        Family of ``tolerances`` that says what is healthy; keys not named have no healthy spread.
    inverse : str
        A key that is searched for by its inverse (a stiffness, by compliance); empty: none.
    moments : tuple of str
        Keys that are places of the key ``mass``, searched for as first moments, mass times place:
        the residuals are linear in those.
    at_origin : bool
        Whether it is a force at the origin of its link, and nothing else of that link: links that
        share their origin in every posture are then one target.
    stage : Stage
        When it is corrected, among several that were found together.
    signature : str
        What moves with what.
    separated_by : str
        Poses or channels that tell it from its rivals.
    remedy : str
        What to do about it.
    """

    name: str
    correct: Callable[[Assumed, PoseTable, Change], State]
    fault: Mapping[str, float]
    signature: str
    separated_by: str
    remedy: str
    family: Mapping[str, str] = field(default_factory=dict[str, str])
    inverse: str = ""
    moments: tuple[str, ...] = ()
    at_origin: bool = False
    stage: Stage = Stage.ELSE
