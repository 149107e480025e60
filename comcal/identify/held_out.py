# SPDX-License-Identifier: Apache-2.0
"""The error on poses that the fit has not seen: the number by which a calibration is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from comcal.identify.adjust import adjust
from comcal.identify.linearise import Group
from comcal.identify.unknowns import Unknowns
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import balance_at, first_moments, residual

FOLDS = 10
"""Folds of the cross-validation, or leave-one-out where there are fewer poses."""


@dataclass(frozen=True)
class HeldOut:
    """Prediction errors over poses left out of the fit in turn.

    Parameters
    ----------
    com_rms : float
        Distance of the predicted CoM from the measured line of gravity [m], root mean square.
    com_upper : float
        Upper 95 % end of its interval [m].
    force_rms, moment_rms : float
        Of the total foot wrench [N], [N m].
    poses : int
    rank_lost : int
        Folds without which the rest did not determine everything the whole session does.
    """

    com_rms: float
    com_upper: float
    force_rms: float
    moment_rms: float
    poses: int
    rank_lost: int


def held_out_error(robot: Robot, unknowns: Unknowns, groups: Sequence[Group], rank: int) -> HeldOut:
    """Cross-validate over poses.

    Parameters
    ----------
    rank : int
        Rank of the fit over all poses.

    Returns
    -------
    HeldOut
        All NaN for a single pose: nothing is left to fit.
    """
    rows = sorted(row for group in groups for row in group.rows)
    if len(rows) < 2:
        return HeldOut(np.nan, np.nan, np.nan, np.nan, len(rows), 0)
    folds = min(FOLDS, len(rows))
    distance: list[Array] = []
    force: list[Array] = []
    moment: list[Array] = []
    lost = 0
    for fold in range(folds):
        left_out = set(rows[fold::folds])
        kept = [_pick(g, [r not in left_out for r in g.rows]) for g in groups]
        fit = adjust(robot, unknowns, [g for g in kept if g.rows])
        lost += fit.rank < rank
        for group in groups:
            part = _pick(group, [r in left_out for r in group.rows])
            if part.rows:
                errors = prediction_errors(robot, unknowns, part, fit.theta)
                for store, error in zip((distance, force, moment), errors, strict=True):
                    store.append(error)
    com_rms = _rms(np.concatenate(distance))
    dof = 2 * len(rows)
    return HeldOut(
        com_rms=com_rms,
        com_upper=com_rms * float(np.sqrt(dof / chdtri(dof, 0.95))),
        force_rms=_rms(np.concatenate(force)),
        moment_rms=_rms(np.concatenate(moment)),
        poses=len(rows),
        rank_lost=lost,
    )


def prediction_errors(
    robot: Robot, unknowns: Unknowns, group: Group, theta: Array
) -> tuple[Array, Array, Array]:
    """Return how far a model is from measured poses, without any fitting.

    Returns
    -------
    distance : array, shape (N,)
        Of the predicted carried CoM from the measured line of gravity [m]; its height along the
        line is not measured.
    force, moment : array, shape (N,)
        Size of the residual [N], [N m].
    """
    balance = balance_at(robot, group.carrier, group.q, group.w)
    h, mass = unknowns.moments(theta), float(theta[0]) - group.below_mass
    com = first_moments(balance, h).sum(axis=1) / mass
    off = np.cross(com, balance.F) - balance.M
    distance = np.linalg.norm(off, axis=1) / np.linalg.norm(balance.F, axis=1)
    left = residual(balance, mass, h)
    return distance, np.abs(left[:, 0]), np.linalg.norm(left[:, 1:], axis=1)


def _pick(group: Group, keep: Sequence[bool]) -> Group:
    mask = np.array(keep, dtype=np.bool_)
    return replace(
        group,
        rows=tuple(r for r, k in zip(group.rows, keep, strict=True) if k),
        where=tuple(w for w, k in zip(group.where, keep, strict=True) if k),
        w=group.w[mask],
        q=group.q[mask],
        cov=group.cov[mask],
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
