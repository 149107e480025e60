# SPDX-License-Identifier: Apache-2.0
r"""Fit the statically equivalent serial chain to known CoM components, and predict with it.

``rows @ R = com`` is linear (Cotton 2009 eqs. (10)-(13)). With fewer poses than unknowns, or with
links that always turn together, R is not unique: the minimum-norm solution is returned and only
functionals in the row space are determined. Predictions outside it are refused, not guessed.

Few poses leave few degrees of freedom. Where the scatter has to be estimated from them, Student's
quantile stands in place of 1.96: 12.7 with one degree of freedom, 4.3 with two.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri, stdtrit

from comcal.errors import NotFiniteError, RankError
from comcal.robot.tree import Array

RELATIVE_RANK = 1e-10
"""Singular values below this share of the largest are rounding."""
SAFE_PIVOT = 1e-7
"""A QR factor whose smallest pivot exceeds this share of the largest is of full rank."""
OUTSIDE = 1e-6
"""A row counts as determined if at most this share of its length lies outside the row space."""
FULL_LEVERAGE = 1e-9
"""A row whose leverage is this close to one is fitted whatever its value: leaving it out says
nothing."""


class NoiseKind(Enum):
    """What the standard errors given to the fit mean."""

    KNOWN = "known"
    """All there is: normal intervals, no scaling."""
    FLOOR = "floor"
    """At least this much: scaled up where the residuals ask for it, Student's intervals."""
    RELATIVE = "relative"
    """Weights only: the scale comes from the residuals, Student's intervals."""


@dataclass(frozen=True)
class SescFit:
    """A fitted chain with everything that says how far it may be trusted.

    Parameters
    ----------
    r : array, shape (n_par,)
        Minimum-norm solution [m]; single entries mean something only where ``rank`` is ``n_par``.
    cov : array, shape (n_par, n_par)
        Covariance of the determined part [m^2], ``scale`` included.
    row_space : array, shape (rank, n_par)
        Orthonormal basis of what the poses determine.
    singular_values : array, shape (min(n_eq, n_par),)
        Of the weighted rows, largest first.
    unknowns : int
        Columns that are not zero in every row.
    sigma : array, shape (n_eq,)
        Standard error given for every row [m].
    residuals : array, shape (n_eq,)
        Measured minus fitted [m].
    leverage : array, shape (n_eq,)
        Diagonal of the hat matrix; their sum is the rank.
    left_out : array, shape (n_eq,)
        Measured minus predicted by a fit without that row [m]; infinite where no other row
        determines it.
    chi2 : float
        Weighted sum of squared residuals, before scaling.
    dof : int
        Rows minus rank.
    scale : float
        Factor on ``sigma`` that the residuals asked for.
    noise : NoiseKind
    """

    r: Array
    cov: Array
    row_space: Array
    singular_values: Array
    unknowns: int
    sigma: Array
    residuals: Array
    leverage: Array
    left_out: Array
    chi2: float
    dof: int
    scale: float
    noise: NoiseKind

    @property
    def rank(self) -> int:
        """Number of directions of R that the poses determine."""
        return self.row_space.shape[0]

    @property
    def condition(self) -> float:
        """Ratio of the largest to the smallest singular value that counts."""
        return float(self.singular_values[0] / self.singular_values[self.rank - 1])

    @property
    def left_out_rms(self) -> float:
        """Root mean square of the leave-one-out errors [m]."""
        return float(np.sqrt(np.mean(self.left_out**2)))

    def quantile(self, level: float = 0.95) -> float:
        """Return the factor from sigma to the half width of a two-sided interval."""
        p = 0.5 + 0.5 * level
        known = self.noise is NoiseKind.KNOWN
        return float(ndtri(p)) if known else float(stdtrit(self.dof, p))


@dataclass(frozen=True)
class ComPrediction:
    """CoM components predicted at poses that were not fitted.

    Parameters
    ----------
    com : array, shape (n,)
        [m]; NaN where not determined.
    sigma : array, shape (n,)
        Standard error of the difference to a new measurement [m]; infinite where not determined.
    half_width : array, shape (n,)
        Of the two-sided interval at ``level`` [m].
    is_determined : array of bool, shape (n,)
        Whether the fitted poses say anything about this row.
    level : float
    """

    com: Array
    sigma: Array
    half_width: Array
    is_determined: npt.NDArray[np.bool_]
    level: float


def fit_sesc(
    rows: Array,
    com: Array,
    sigma: Array | None = None,
    noise: NoiseKind = NoiseKind.FLOOR,
) -> SescFit:
    """Fit R by weighted least squares.

    Parameters
    ----------
    rows : array, shape (n_eq, n_par)
        One row of ``B(q)`` per known component.
    com : array, shape (n_eq,)
        Known components [m].
    sigma : array, shape (n_eq,) or None
        Standard error of each [m]; None: all equal and unknown, which makes *noise* RELATIVE.
    noise : NoiseKind
        What *sigma* means.

    Returns
    -------
    SescFit

    Raises
    ------
    NotFiniteError
        If a row or a component is NaN or infinite, or a sigma is not positive.
    RankError
        If there are no rows; if the scale is to come from residuals and no degree of freedom is
        left to estimate it.
    """
    if sigma is None:
        sigma, noise = np.ones(len(com)), NoiseKind.RELATIVE
    _check_rows(rows, com, sigma)
    U, s, Vt, keep = _decompose(rows / sigma[:, None])
    unknowns, rank = count_unknowns(rows)[0], int(keep.sum())
    dof = len(com) - rank
    if dof < 1 and noise is not NoiseKind.KNOWN:
        raise RankError(
            "as many unknowns as known CoM components: every fit is perfect and says nothing",
            measured=f"{len(com)} components, rank {rank}",
            limit="at least one component more than the rank",
            next_step="record more poses, or give a chain with fewer joints",
        )
    U, inverse, Vr = U[:, :rank], 1.0 / s[:rank], Vt[:rank]
    weighted = com / sigma
    r = Vr.T @ (inverse * (U.T @ weighted))
    residuals = com - rows @ r
    chi2 = float(np.sum((residuals / sigma) ** 2))
    scale = _scale(chi2, dof, noise)
    leverage = np.sum(U**2, axis=1)
    return SescFit(
        r=r,
        cov=scale**2 * (Vr.T * inverse**2) @ Vr,
        row_space=Vr,
        singular_values=s,
        unknowns=unknowns,
        sigma=sigma,
        residuals=residuals,
        leverage=leverage,
        left_out=_left_out(residuals, leverage),
        chi2=chi2,
        dof=dof,
        scale=scale,
        noise=noise,
    )


def predict_com(
    fit: SescFit, rows: Array, sigma: npt.ArrayLike = 0.0, level: float = 0.95
) -> ComPrediction:
    """Predict CoM components at other poses.

    Parameters
    ----------
    fit : SescFit
    rows : array, shape (n, n_par)
        Rows of ``B(q)`` at the poses and components wanted.
    sigma : array, shape (n,), or float
        Standard error of the new measurement with which the prediction will be compared [m], in the
        same sense as those of the fit: it is scaled with them. Zero: the interval of the CoM
        itself.
    level : float
        Probability of the two-sided interval.

    Returns
    -------
    ComPrediction
    """
    outside = rows - (rows @ fit.row_space.T) @ fit.row_space
    length = np.linalg.norm(rows, axis=1)
    is_determined = np.linalg.norm(outside, axis=1) <= OUTSIDE * length
    variance = np.einsum("ij,jk,ik->i", rows, fit.cov, rows)
    variance = variance + (fit.scale * np.asarray(sigma, dtype=np.float64)) ** 2
    spread = np.where(is_determined, np.sqrt(variance), np.inf)
    return ComPrediction(
        com=np.where(is_determined, rows @ fit.r, np.nan),
        sigma=spread,
        half_width=fit.quantile(level) * spread,
        is_determined=is_determined,
        level=level,
    )


def left_out_errors(rows: Array, com: Array) -> Array:
    """Return leave-one-out errors of equally weighted fits, batched over leading axes.

    A fit without row i misses it by ``residual_i / (1 - leverage_i)``, without refitting.

    Parameters
    ----------
    rows : array, shape (..., n_eq, n_par)
    com : array, shape (..., n_eq)

    Returns
    -------
    errors : array, shape (..., n_eq)
        Measured minus predicted [m]; infinite where no other row determines the row.
    """
    used = rows[..., np.any(rows != 0.0, axis=tuple(range(rows.ndim - 1)))]
    Q, R = np.linalg.qr(used)
    pivots = np.abs(np.diagonal(R, axis1=-2, axis2=-1))
    if not bool(np.all(pivots.min(axis=-1) > SAFE_PIVOT * pivots.max(axis=-1))):
        # Some set is short of rank, where QR without exchange of columns cannot be trusted.
        U, _, _, keep = _decompose(used)
        Q = U * keep[..., None, :]
    fitted = Q @ (np.swapaxes(Q, -1, -2) @ com[..., None])
    return _left_out(com - fitted[..., 0], np.sum(Q**2, axis=-1))


def count_unknowns(rows: Array) -> tuple[int, int]:
    """Return how many columns are not zero throughout, and the rank of *rows*.

    Parameters
    ----------
    rows : array, shape (n_eq, n_par)
    """
    largest = np.abs(rows).max(axis=0)
    keep = _decompose(rows)[3]
    return int((largest > RELATIVE_RANK * largest.max()).sum()), int(keep.sum())


def _decompose(rows: Array) -> tuple[Array, Array, Array, npt.NDArray[np.bool_]]:
    """Return the thin SVD and which singular values count."""
    U, s, Vt = np.linalg.svd(rows, full_matrices=False)
    return U, s, Vt, s > RELATIVE_RANK * s[..., :1]


def _left_out(residuals: Array, leverage: Array) -> Array:
    """Return ``residual / (1 - leverage)``, infinite at full leverage."""
    free = 1.0 - leverage
    errors = np.full(residuals.shape, np.inf)
    return np.divide(residuals, free, out=errors, where=free > FULL_LEVERAGE)


def _scale(chi2: float, dof: int, noise: NoiseKind) -> float:
    """Return the factor on sigma that the residuals ask for."""
    if noise is NoiseKind.KNOWN:
        return 1.0
    estimated = float(np.sqrt(chi2 / dof))
    return max(1.0, estimated) if noise is NoiseKind.FLOOR else estimated


def _check_rows(rows: Array, com: Array, sigma: Array) -> None:
    """Refuse what least squares would turn into nonsense without a word."""
    if len(com) == 0 or not bool(np.any(rows)):
        raise RankError(
            "no CoM component is known",
            next_step="give com.x, com.y or com.z in poses.csv",
        )
    bad = ~(np.isfinite(rows).all(axis=1) & np.isfinite(com) & np.isfinite(sigma) & (sigma > 0.0))
    if bool(bad.any()):
        raise NotFiniteError(
            "a CoM component, its standard error or a joint position is not a number",
            where=f"row {int(np.flatnonzero(bad)[0])} of the fit",
            next_step="fill the cell, or set `use` to 0 for that pose",
        )
