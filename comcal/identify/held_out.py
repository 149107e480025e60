# SPDX-License-Identifier: Apache-2.0
"""The error on poses that the fit has not seen: the number by which a calibration is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtri

from comcal.identify.adjust import adjust
from comcal.identify.cut_errors import CutError, cut_errors, summarised
from comcal.identify.groups import Group
from comcal.identify.linearise import model_at, without_offsets
from comcal.identify.unknowns import Unknowns
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import first_moments, residual
from comcal.statics.static_rows import row_residual

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
    torque_rms : float
        Of joint torques, given the measured foot wrench [N m]; NaN where none is used.
    cuts : tuple of CutError
        Sensors that do not carry the robot.
    chosen : bool
        The poses were named and not fitted at all, instead of being left out in turn.
    """

    com_rms: float
    com_upper: float
    force_rms: float
    moment_rms: float
    poses: int
    rank_lost: int
    torque_rms: float = np.nan
    cuts: tuple[CutError, ...] = ()
    chosen: bool = False


@dataclass
class _Errors:
    """Prediction errors, as they are collected."""

    distance: list[Array] = field(default_factory=list[Array])
    force: list[Array] = field(default_factory=list[Array])
    moment: list[Array] = field(default_factory=list[Array])
    torque: list[Array] = field(default_factory=list[Array])
    cuts: dict[str, list[Array]] = field(default_factory=dict[str, list[Array]])

    def add(self, robot: Robot, unknowns: Unknowns, part: Group, theta: Array) -> None:
        """Predict the poses of *part* from *theta*."""
        if not part.rows:
            return
        if part.layout.torques:
            self.torque.append(torque_errors(robot, unknowns, part, theta).ravel())
        for sensor, error in cut_errors(robot, unknowns, part, theta).items():
            self.cuts.setdefault(sensor, []).append(error)
        if not part.layout.hangs:
            errors = prediction_errors(robot, unknowns, part, theta)
            for store, error in zip((self.distance, self.force, self.moment), errors, strict=True):
                store.append(error)

    def summary(self, *, lost: int, chosen: bool) -> HeldOut:
        """Return the root mean squares."""
        com_rms = _rms(self.distance)
        standing = sum(len(part) for part in self.distance)
        return HeldOut(
            com_rms=com_rms,
            com_upper=upper_95(com_rms, standing),
            force_rms=_rms(self.force),
            moment_rms=_rms(self.moment),
            poses=standing,
            rank_lost=lost,
            torque_rms=_rms(self.torque),
            cuts=summarised(self.cuts),
            chosen=chosen,
        )


def named_error(robot: Robot, unknowns: Unknowns, groups: Sequence[Group], theta: Array) -> HeldOut:
    """Predict poses that took no part in a fit.

    Parameters
    ----------
    groups : sequence of Group
        Of those poses alone.
    theta : array, shape (size,)
        What was fitted to others.
    """
    errors = _Errors()
    for group in groups:
        errors.add(robot, unknowns, group, theta)
    return errors.summary(lost=0, chosen=True)


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
    standing = sum(len(group.rows) for group in groups if not group.layout.hangs)
    if len(rows) < 2:
        return HeldOut(np.nan, np.nan, np.nan, np.nan, standing, 0)
    folds = min(FOLDS, len(rows))
    errors = _Errors()
    lost = 0
    for fold in range(folds):
        left_out = set(rows[fold::folds])
        kept = [group.select([r not in left_out for r in group.rows]) for group in groups]
        fit = adjust(robot, unknowns, [group for group in kept if group.rows])
        lost += fit.rank < rank
        for group in groups:
            part = group.select([r in left_out for r in group.rows])
            errors.add(robot, unknowns, part, fit.theta)
    return errors.summary(lost=lost, chosen=False)


def upper_95(com_rms: float, poses: int) -> float:
    """Return the upper 95 % end of a root mean square distance from lines of gravity.

    Parameters
    ----------
    com_rms : float
        [m], two independent components per pose.
    poses : int

    Returns
    -------
    float
        [m]; NaN without a pose.
    """
    dof = 2 * poses
    return com_rms * float(np.sqrt(dof / chdtri(dof, 0.95))) if poses else np.nan


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
    balance = group.balance_at(robot, without_offsets(unknowns, group, theta))
    model = model_at(unknowns, group, theta)
    com = first_moments(balance, model.h, model.masses).sum(axis=1) / model.mass
    off = np.cross(com, balance.F) - balance.M
    distance = np.linalg.norm(off, axis=1) / np.linalg.norm(balance.F, axis=1)
    left = residual(balance, model.mass, model.h, model.masses)
    return distance, np.abs(left[:, 0]), np.linalg.norm(left[:, 1:], axis=1)


def torque_errors(robot: Robot, unknowns: Unknowns, group: Group, theta: Array) -> Array:
    """Return measured less predicted joint torques, without any fitting, (N, n_torques) [N m]."""
    inputs = without_offsets(unknowns, group, theta)
    wrenches, torques = group.others(inputs)
    balance = group.balance_at(robot, inputs)
    model = model_at(unknowns, group, theta)
    left = row_residual(group.layout, balance, wrenches, torques, model)
    return left[:, group.layout.torque_rows]


def _rms(parts: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else np.nan
