# SPDX-License-Identifier: Apache-2.0
r"""How much more likely the residuals are with a cause than without it.

With whitened columns A, residuals r, and a fault of each coordinate normal with standard deviation
F, the logarithm of the ratio of evidences is

.. math:: \tfrac12 b^T M^{-1} b - \tfrac12 \ln\det(1 + F A^T A F),
   \qquad M = A^T A + F^{-2}, \quad b = A^T r .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array


@dataclass(frozen=True)
class Explanation:
    """What a set of causes explains.

    Parameters
    ----------
    log_odds : float
        ln evidence with the causes - ln evidence without any.
    coordinates : array, shape (k,)
    cov : array, shape (k, k)
    chi2 : float
        Of the residuals that are left.
    """

    log_odds: float
    coordinates: Array
    cov: Array
    chi2: float


def explained(residuals: Array, columns: Array, fault: Array) -> Explanation:
    """Explain whitened residuals by causes.

    Parameters
    ----------
    residuals : array, shape (m,)
    columns : array, shape (m, k)
    fault : array, shape (k,)
        Size of a fault along each coordinate.
    """
    A = columns * fault
    M = A.T @ A + np.eye(A.shape[1])
    b = A.T @ residuals
    scaled = np.linalg.solve(M, b)
    log_odds = 0.5 * float(b @ scaled) - 0.5 * float(np.linalg.slogdet(M)[1])
    left = residuals - A @ scaled
    cov = np.linalg.inv(M) * np.outer(fault, fault)
    return Explanation(log_odds, fault * scaled, cov, float(left @ left))
