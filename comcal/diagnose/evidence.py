# SPDX-License-Identifier: Apache-2.0
r"""How much more likely the residuals are with a cause than without it.

With columns A, residuals r, their inner products K = A^T C^{-1} A and b = A^T C^{-1} r, and a fault
of each coordinate normal with standard deviation F, the logarithm of the ratio of evidences is

.. math:: \tfrac12 b^T M^{-1} b - \tfrac12 \ln\det(F M F), \qquad M = K + F^{-2} .

Causes that are there already belong to C, each with the spread of a fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from comcal.diagnose.catalogue import Catalogue
from comcal.diagnose.metric import Metric, Products, metric
from comcal.robot.tree import Array

IMPOSSIBLE = -np.inf
"""Log odds of a cause that would need a negative mass, stiffness or friction."""


@dataclass(frozen=True)
class Explanation:
    """What a cause explains.

    Parameters
    ----------
    log_odds : float
        ln evidence with it - ln evidence without it; of a candidate, with its prior.
    coordinates : array, shape (k,)
    cov : array, shape (k, k)
    """

    log_odds: float
    coordinates: Array
    cov: Array


def explained(
    K: Array,
    b: Array,
    fault: Array,
    positive: npt.NDArray[np.bool_] | None = None,
    required: npt.NDArray[np.bool_] | None = None,
) -> Explanation:
    """Explain residuals by a cause.

    Parameters
    ----------
    K : array, shape (k, k)
    b : array, shape (k,)
    fault : array, shape (k,)
    positive, required : array of bool, shape (k,), optional
        Coordinates that cannot be negative are left out where they would be; without a required
        one there is no cause.
    """
    k = len(b)
    kept = np.ones(k, np.bool_)
    while True:
        F = fault[kept]
        M = F[:, None] * K[np.ix_(kept, kept)] * F
        M[np.diag_indices_from(M)] += 1.0
        scaled = np.linalg.solve(M, F * b[kept])
        x = np.zeros(k)
        x[kept] = F * scaled
        wrong = np.zeros(k, np.bool_) if positive is None else positive & kept & (x <= 0.0)
        if not wrong.any():
            break
        kept &= ~wrong
        if not kept.any() or (required is not None and (wrong & required).any()):
            return Explanation(IMPOSSIBLE, np.zeros(k), np.zeros((k, k)))
    log_odds = 0.5 * float((F * b[kept]) @ scaled) - 0.5 * float(np.linalg.slogdet(M)[1])
    cov = np.zeros((k, k))
    cov[np.ix_(kept, kept)] = np.linalg.inv(M) * np.outer(F, F)
    return Explanation(log_odds, x, cov)


def explain(of: Catalogue, i: int, against: Metric) -> Explanation:
    """Explain residuals by candidate *i* of a catalogue, whose prior counts."""
    part = of.slices[i]
    found = explained(
        against.K[part, part],
        against.b[part],
        of.fault[part],
        of.positive[part],
        of.required[part],
    )
    return replace(found, log_odds=found.log_odds + of.log_prior[i])


def all_log_odds(of: Catalogue, against: Metric) -> Array:
    """Return the log odds of every candidate against nothing more, shape (n_candidates,).

    Candidates with as many coordinates are solved together.
    """
    found = np.full(len(of.candidates), IMPOSSIBLE)
    for numbers, at in of.by_size:
        F = of.fault[at]
        M = against.K[at[:, :, None], at[:, None, :]] * F[:, :, None] * F[:, None, :]
        M += np.eye(at.shape[1])
        b = F * against.b[at]
        scaled = np.linalg.solve(M, b[..., None])[..., 0]
        found[numbers] = 0.5 * (np.sum(b * scaled, axis=1) - np.linalg.slogdet(M)[1])
        found[numbers] += of.log_prior[numbers]
        for n in np.flatnonzero((of.positive[at] & (scaled <= 0.0)).any(axis=1)):
            found[numbers[n]] = explain(of, int(numbers[n]), against).log_odds
    return np.where(of.open, found, IMPOSSIBLE)


def whole(
    of: Catalogue, causes: tuple[int, ...], seen: Products, scales: Mapping[str, float]
) -> Explanation:
    """Explain residuals by several candidates at once; coordinates one cause after the other.

    Each is all that the robot is off by there, the fault and the healthy part together: no reading
    tells the two from each other, and it is the sum that a model needs. The log odds are finite
    if that is possible, and mean nothing else.

    Parameters
    ----------
    of : Catalogue
    causes : tuple of int
    seen : Products
        Of columns and residuals, whitened by noise alone.
    scales : mapping from family to float
        Factors on healthy tolerances.
    """
    at = np.concatenate([np.arange(of.slices[i].start, of.slices[i].stop) for i in causes])
    healthy, size = of.spread(scales)[at], of.spread(scales, causes)[at]
    positive, required = of.positive[at], of.required[at]
    beside = of.spread(scales)
    beside[at] = 0.0
    alone = metric(seen, beside, at)
    found = explained(alone.K, alone.b, size, positive, required)
    bounded = np.zeros(len(at), np.bool_)
    while np.any(more := positive & ~bounded & (found.coordinates == 0.0) & (healthy > 0.0)):
        # Nothing is wrong along these, but what is healthy may still be there.
        bounded |= more
        beside[at] = np.where(bounded, healthy, 0.0)
        against = metric(seen, beside, at)
        others = np.where(bounded, 0.0, size)
        again = explained(against.K, against.b, others, positive, required)
        if not np.isfinite(again.log_odds):
            return found
        found = again
    if not bounded.any():
        return found
    left = np.linalg.inv(alone.K + np.diag(np.where(bounded, healthy, size) ** -2.0))
    return replace(found, cov=found.cov + np.diag(np.where(bounded, np.diag(left), 0.0)))
