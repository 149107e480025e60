# SPDX-License-Identifier: Apache-2.0
"""Result of fitting a chain without masses or lengths to known CoM components."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from comcal.identify.convention_ranking import Ranking
from comcal.identify.conventions import Conventions
from comcal.identify.sesc_fit import SescFit

FEWEST_DOF = 3
"""Below this the 95 % interval is more than 3.2 times sigma: the scatter is guessed, not known."""


class Usability(Enum):
    """Whether predictions of the fitted chain are worth anything."""

    USABLE = "usable"
    HARDLY_USABLE = "hardly usable"


@dataclass(frozen=True)
class PosePrediction:
    """One CoM component of one held-out pose; lengths in [m].

    Parameters
    ----------
    pose : int
    component : str
        ``x``, ``y`` or ``z``.
    predicted : float
        NaN where the fitted poses do not determine it.
    half_width : float
        Of the 95 % interval in which a new measurement should lie.
    rounding : (float, float)
        Middle 95 % of the predictions from tables that would have been rounded to the given one.
    conventions : (float, float)
        Smallest and largest prediction over the readings that cannot be told from the best.
    measured : float
        What was measured. Enters nothing else.
    """

    pose: int
    component: str
    predicted: float
    half_width: float
    rounding: tuple[float, float]
    conventions: tuple[float, float]
    measured: float

    @property
    def error(self) -> float:
        """Predicted minus measured [m]."""
        return self.predicted - self.measured

    @property
    def is_inside(self) -> bool:
        """Whether the measurement lies in the interval."""
        return abs(self.error) <= self.half_width


@dataclass(frozen=True)
class PosturesResult:
    """A fitted statically equivalent serial chain and what it is worth.

    Parameters
    ----------
    robot : str
    fitted : tuple of int
        Ids of the poses that were fitted.
    conventions : Conventions
    ranking : Ranking
        Readings of the table, chosen by ``fitted`` alone.
    fit : SescFit
        Under the chosen reading.
    columns : tuple of str
        Names of the table's columns, which are those of the chain's joints.
    labels : tuple of str
        Names of the entries of ``fit.r``.
    com_spread : float
        Standard deviation of the fitted components about their mean [m]: the error of guessing
        the mean for every pose. The largest one, if several components are given.
    predictions : tuple of PosePrediction
    seed : int
        Of the tables drawn within the rounding.
    """

    robot: str
    fitted: tuple[int, ...]
    conventions: Conventions
    ranking: Ranking
    fit: SescFit
    columns: tuple[str, ...]
    labels: tuple[str, ...]
    com_spread: float
    predictions: tuple[PosePrediction, ...]
    seed: int

    @property
    def held_out_rms(self) -> float:
        """Root mean square of predicted minus measured [m]; NaN without held-out poses."""
        errors = [p.error for p in self.predictions]
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else np.nan

    @property
    def half_widths(self) -> tuple[float, float]:
        """Smallest and largest half width over the held-out poses [m]."""
        widths = [p.half_width for p in self.predictions]
        return (min(widths), max(widths)) if widths else (np.nan, np.nan)

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """Why the predictions are hardly usable; empty if they are usable."""
        found: list[str] = []
        if self.fit.dof < FEWEST_DOF:
            found.append(
                f"{len(self.fitted)} poses for {self.fit.unknowns} unknowns leave "
                f"{self.fit.dof} degree{'s' if self.fit.dof != 1 else ''} of freedom"
            )
        widths = [p.half_width for p in self.predictions]
        if widths and float(np.median(widths)) > self.com_spread:
            low, high = self.half_widths
            found.append(
                f"intervals of +/-{1e3 * low:.0f} to +/-{1e3 * high:.0f} mm, while guessing the "
                f"mean of the fitted poses errs by {1e3 * self.com_spread:.0f} mm"
            )
        tied = len(self.ranking.tied)
        if tied > 1:
            found.append(
                f"{tied} of {len(self.ranking.scored)} readings of the table cannot be told apart"
            )
        return tuple(found)

    @property
    def usability(self) -> Usability:
        """The verdict in one word."""
        return Usability.HARDLY_USABLE if self.reasons else Usability.USABLE

    @property
    def verdict(self) -> str:
        """The verdict in one sentence."""
        word = self.usability.value
        return f"{word}: {'; '.join(self.reasons)}" if self.reasons else word
