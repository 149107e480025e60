# SPDX-License-Identifier: Apache-2.0
"""One linearisation: whitened residuals and columns of all candidates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from comcal.diagnose.catalogue import Catalogue
from comcal.diagnose.linear import Linear
from comcal.diagnose.metric import Metric, Products, metric, products, respread
from comcal.diagnose.whitening import Whitening, whitening
from comcal.effects.effect import State
from comcal.robot.tree import Array


@dataclass(frozen=True)
class Scene:
    """What all scores are made of.

    Parameters
    ----------
    of : Catalogue
    origin : State
        The model and the readings as given.
    at : Linear
        The state about which everything is linear.
    centre : array, shape (p,)
        Coordinates of the causes that this state has taken out.
    fitted : array, shape (p,)
        Coordinates at which columns of causes were found; NaN: about none.
    raw : array, shape (n, p)
        What each coordinate adds to the residuals.
    by : Whitening
    X : array, shape (m, p)
        The same, whitened by noise.
    r : array, shape (m,)
        Residuals of the model as given, whitened by noise; of causes that were fitted, what
        they come to with the columns X.
    scales : mapping from family to float
        Factors on healthy tolerances.
    """

    of: Catalogue
    origin: State
    at: Linear
    centre: Array
    fitted: Array
    raw: Array
    by: Whitening
    X: Array
    r: Array
    scales: Mapping[str, float]

    @cached_property
    def products(self) -> Products:
        """Inner products after whitening by noise."""
        return products(self.X, self.r)

    @cached_property
    def healthy(self) -> Metric:
        """The metric in which nothing but the healthy spread is there."""
        return metric(self.products, self.of.spread(self.scales))

    def against(self, causes: Sequence[int] = ()) -> Metric:
        """Return the metric in which *causes* may be there."""
        of = self.of
        return respread(self.healthy, of.spread(self.scales), of.spread(self.scales, causes))

    def log_evidence(self, causes: Sequence[int] = ()) -> float:
        """Return ln p(residuals, causes) with *causes* as large as faults.

        Up to a constant per row: only evidences of the same rows compare.
        """
        prior = float(self.of.log_prior[list(causes)].sum())
        return self.against(causes).log_likelihood + prior - self.by.log_det


def scene(of: Catalogue, state: State, noise: float = 1.0) -> Scene:
    """Linearise the residuals of a state.

    Parameters
    ----------
    of : Catalogue
    state : State
    noise : float
        Factor on the errors stated of the readings.
    """
    at = Linear(*state)
    by = whitening(at, noise)
    raw = of.columns(at)
    X, r = by.turned(raw), by.turned(np.nan_to_num(at.at.values))
    p = len(of.fault)
    return Scene(of, state, at, np.zeros(p), np.full(p, np.nan), raw, by, X, r, {})
