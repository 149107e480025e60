# SPDX-License-Identifier: Apache-2.0
"""Fit and predict under one reading of the table, and say how far rounding and reading matter."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from comcal.identify.convention_ranking import draw_tables
from comcal.identify.conventions import Convention, Rounding, convention_matrix
from comcal.identify.known_com import KnownCom
from comcal.identify.sesc_fit import (
    RELATIVE_RANK,
    ComPrediction,
    SescFit,
    fit_sesc,
    predict_com,
)
from comcal.robot.tree import Array
from comcal.statics.sesc import SescChain, sesc_jacobian


def fit_convention(
    chain: SescChain, convention: Convention, fitting: KnownCom, rounding: Rounding
) -> SescFit:
    """Fit R when the table is read by *convention*.

    An error of an angle moves the CoM by the Jacobian, which needs R: a first fit with equal
    weights gives it, a second one weighs every equation by the error that it then has. The
    residuals may scale that error up, never down: trunks that bend and feet that move are not in
    it.

    Raises
    ------
    RankError
        If no degree of freedom is left.
    """
    rows = fitting.pick(convention_matrix(chain, convention, fitting.q))
    first = fit_sesc(rows, fitting.com)
    sigma = known_errors(chain, convention, fitting, rounding, first.r)
    return fit_sesc(rows, fitting.com, sigma) if bool(np.all(sigma > 0.0)) else first


def predict_convention(
    chain: SescChain,
    convention: Convention,
    fit: SescFit,
    poses: KnownCom,
    rounding: Rounding,
    level: float = 0.95,
) -> ComPrediction:
    """Predict the components that *poses* lists; their values are not looked at.

    The interval is that of the difference to a new measurement.
    """
    rows = poses.pick(convention_matrix(chain, convention, poses.q))
    sigma = known_errors(chain, convention, poses, rounding, fit.r)
    if not bool(np.all(sigma > 0.0)):
        sigma = np.ones(len(poses))
    return predict_com(fit, rows, sigma, level)


def known_errors(
    chain: SescChain, convention: Convention, known: KnownCom, rounding: Rounding, r: Array
) -> Array:
    """Return the error of every equation that is known beforehand, shape (n_eq,) [m].

    Standard errors of the table, or what the rounding alone makes (half width over the square root
    of three), whichever is larger; angles count through ``d CoM / d q``.
    """
    q_var = np.maximum(known.q_var, rounding.of_joints(chain.tree) ** 2 / 3.0)
    com_var = np.maximum(known.com_var, rounding.length**2 / 3.0)
    J = sesc_jacobian(chain, convention.joint_positions(known.q), r)
    through = known.pick(J**2)
    return np.sqrt(
        com_var + np.sum(through * q_var[known.row][:, list(convention.columns)], axis=1)
    )


def rounding_spread(
    chain: SescChain,
    convention: Convention,
    fit: SescFit,
    fitting: KnownCom,
    poses: KnownCom,
    rounding: Rounding,
    rng: np.random.Generator,
    draws: int = 200,
) -> tuple[Array, Array]:
    """Predict from tables that would have been rounded to the given one.

    Weights stay those of *fit*. The values of *poses* are not looked at.

    Returns
    -------
    low, high : array, shape (n,)
        Ends of the middle 95 % of the predictions [m].
    """
    q_fit, com = draw_tables(chain.tree, rounding, fitting, rng, draws)
    q_new, _ = draw_tables(chain.tree, rounding, poses, rng, draws)
    rows = fitting.pick(convention_matrix(chain, convention, q_fit)) / fit.sigma[:, None]
    wanted = poses.pick(convention_matrix(chain, convention, q_new))
    r = np.einsum("dij,dj->di", np.linalg.pinv(rows, rcond=RELATIVE_RANK), com / fit.sigma)
    low, high = np.quantile(np.einsum("dij,dj->di", wanted, r), [0.025, 0.975], axis=0)
    return low, high


def convention_spread(
    chain: SescChain,
    conventions: Iterable[Convention],
    fitting: KnownCom,
    poses: KnownCom,
    rounding: Rounding,
) -> tuple[Array, Array]:
    """Predict under every one of several readings of the table as printed.

    Returns
    -------
    low, high : array, shape (n,)
        Smallest and largest prediction [m].
    """
    predicted = [
        predict_convention(
            chain, c, fit_convention(chain, c, fitting, rounding), poses, rounding
        ).com
        for c in conventions
    ]
    return np.min(predicted, axis=0), np.max(predicted, axis=0)
