# SPDX-License-Identifier: Apache-2.0
r"""Inner products of residuals and columns, against noise and healthy spread together.

A healthy robot has residuals of covariance C = N + T D^2 T^T: noise N, and columns T of everything
that may be a little off, with standard deviations D. After whitening with N,

.. math:: x^T C^{-1} y = \tilde x^T \tilde y
    - \tilde x^T \tilde T D (1 + D \tilde T^T \tilde T D)^{-1} D \tilde T^T \tilde y ,

so all that is ever needed are the inner products of the whitened columns with one another and with
the residuals; another D costs no new residuals. Where D changes in a few places S only, nor does it
cost another factorisation: with inner products K of the old metric and D^2 changed by E,

.. math:: K' = K - K_S (1 + E K_{SS})^{-1} E K_S^T , \qquad
    \ln\det C' = \ln\det C + \ln\det(1 + E K_{SS}) .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import cholesky, solve_triangular

from comcal.robot.tree import Array


@dataclass(frozen=True)
class Products:
    """Inner products after whitening with the noise alone.

    Parameters
    ----------
    K : array, shape (p, p)
        Of the columns.
    b : array, shape (p,)
        Of the columns and the residuals.
    rr : float
        Of the residuals.
    rows : int
    """

    K: Array
    b: Array
    rr: float
    rows: int

    def __sub__(self, other: Products) -> Products:
        return Products(
            self.K - other.K, self.b - other.b, self.rr - other.rr, self.rows - other.rows
        )


def products(columns: Array, residuals: Array) -> Products:
    """Return the inner products of whitened columns (m, p) and residuals (m,)."""
    return Products(
        columns.T @ columns, columns.T @ residuals, float(residuals @ residuals), len(residuals)
    )


@dataclass(frozen=True)
class Metric:
    """Inner products against noise and healthy spread.

    Parameters
    ----------
    K, b, rr : array (p, p), array (p,), float
        As in :class:`Products`.
    rows : int
    log_det : float
        ln det C - ln det N.
    """

    K: Array
    b: Array
    rr: float
    rows: int
    log_det: float

    @property
    def log_likelihood(self) -> float:
        """Ln p(residuals) of a healthy robot, up to a constant of the noise."""
        return -0.5 * (self.rr + self.log_det)


def metric(of: Products, spread: Array, only: npt.NDArray[np.intp] | slice = slice(None)) -> Metric:
    """Add the healthy spread.

    Parameters
    ----------
    of : Products
    spread : array, shape (p,)
        Standard deviation of every column of a healthy robot; 0: none.
    only : array of int or slice
        Columns whose products are asked for; default all.
    """
    at = np.flatnonzero(spread)
    K, b = of.K[:, only], of.b[only]
    if not at.size:
        return Metric(K[only], b, of.rr, of.rows, 0.0)
    D = spread[at]
    M = D[:, None] * of.K[np.ix_(at, at)] * D
    M[np.diag_indices_from(M)] += 1.0
    L = cholesky(M, lower=True, check_finite=False)
    half = solve_triangular(
        L, D[:, None] * np.column_stack([K[at], of.b[at]]), lower=True, check_finite=False
    )
    across, right = half[:, :-1], half[:, -1]
    return Metric(
        K[only] - across.T @ across,
        b - across.T @ right,
        of.rr - float(right @ right),
        of.rows,
        2.0 * float(np.log(np.diag(L)).sum()),
    )


def respread(of: Metric, old: Array, new: Array) -> Metric:
    """Change the spread of a few columns.

    Parameters
    ----------
    of : Metric
        With the spread *old*.
    old, new : array, shape (p,)
        Standard deviations.
    """
    at = np.flatnonzero(old != new)
    if not at.size:
        return of
    E = (new[at] ** 2 - old[at] ** 2)[:, None]
    M = E * of.K[np.ix_(at, at)]
    M[np.diag_indices_from(M)] += 1.0
    taken = np.linalg.solve(M, E * np.column_stack([of.K[at], of.b[at]]))
    K = of.K - of.K[:, at] @ taken[:, :-1]
    right = taken[:, -1]
    return Metric(
        0.5 * (K + K.T),
        of.b - of.K[:, at] @ right,
        of.rr - float(of.b[at] @ right),
        of.rows,
        of.log_det + float(np.linalg.slogdet(M)[1]),
    )
