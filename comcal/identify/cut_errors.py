# SPDX-License-Identifier: Apache-2.0
"""Sensors that do not carry the robot: what hangs below them, and how well it is predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.adjust import Adjustment
from comcal.identify.cad_inputs import cad_inputs
from comcal.identify.groups import Group
from comcal.identify.linearise import model_at, without_offsets
from comcal.identify.unknowns import Unknowns
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.cut_rows import cut_transform
from comcal.statics.static_rows import row_residual

SEEN_SHARE = 0.1
"""As of single links: a mass counts as measured below this share in unseen directions."""


@dataclass(frozen=True)
class CutError:
    """Prediction error of one sensor over poses that were not fitted.

    Parameters
    ----------
    sensor : str
    force, moment : array, shape (3,)
        Root mean square by channel, in the sensor's frame [N], [N m].
    poses : int
    """

    sensor: str
    force: Array
    moment: Array
    poses: int


@dataclass(frozen=True)
class MassBelow:
    """What hangs below a sensor that does not carry the robot.

    Parameters
    ----------
    sensor : str
    mass, sigma : float
        As measured [kg]; NaN where it is not determined.
    urdf : float
        [kg]
    """

    sensor: str
    mass: float
    sigma: float
    urdf: float


def cut_errors(robot: Robot, unknowns: Unknowns, group: Group, theta: Array) -> dict[str, Array]:
    """Return measured less predicted wrench of every cut of a group, without any fitting.

    Returns
    -------
    dict from sensor name to array, shape (N, 6)
        In and about the sensor's frame [N, N m].
    """
    inputs = without_offsets(unknowns, group, theta)
    wrenches, torques = group.others(inputs)
    balance = group.balance_at(robot, inputs)
    left = row_residual(group.layout, balance, wrenches, torques, model_at(unknowns, group, theta))
    found: dict[str, Array] = {}
    for i, cut in enumerate(group.layout.cuts):
        in_root = left[:, group.layout.cut_rows(i), None]
        off = np.linalg.solve(cut_transform(balance, cut), in_root)[:, :, 0]
        found[cut.sensor] = np.asarray(off, np.float64)
    return found


def summarised(errors: dict[str, list[Array]]) -> tuple[CutError, ...]:
    """Return the root mean squares of errors collected by sensor, each shape (N, 6)."""
    found: list[CutError] = []
    for sensor, parts in errors.items():
        every = np.concatenate(parts)
        rms = np.sqrt(np.mean(every**2, axis=0))
        found.append(CutError(sensor, rms[:3], rms[3:], len(every)))
    return tuple(found)


def masses_below(fit: Adjustment) -> tuple[MassBelow, ...]:
    """Return what hangs below each cut that took part, where the masses of links are unknown."""
    if not fit.unknowns.free_masses:
        return ()
    cov = fit.cov + fit.cov_cad + cad_inputs(fit).cov
    cuts = {cut.sensor: cut for group in fit.groups for cut in group.layout.cuts}
    robot = fit.unknowns.robot
    found: list[MassBelow] = []
    for sensor in cuts:
        below = robot.below_cut[sensor]
        L, known = fit.unknowns.mass_functional(below)
        if not L.any():
            continue
        seen = bool(fit.visibility(L) < SEEN_SHARE)
        mass = float(L @ fit.theta) + known if seen else np.nan
        sigma = float(np.sqrt(L @ cov @ L)) if seen else np.nan
        found.append(MassBelow(sensor, mass, sigma, float(robot.tree.masses[below].sum())))
    return tuple(found)
