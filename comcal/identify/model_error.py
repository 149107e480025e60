# SPDX-License-Identifier: Apache-2.0
"""How far a given model is from measured poses; nothing is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from comcal.identify.groups import groups_of
from comcal.identify.held_out import prediction_errors, upper_95
from comcal.identify.unknowns import unknowns_of
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.coefficients import balance_coefficients
from comcal.statics.support import carrier_of


@dataclass(frozen=True)
class ModelError:
    """Prediction errors of a model, pose by pose, as :class:`HeldOut` defines them.

    Parameters
    ----------
    poses : tuple of int
        Ids of the standing poses, in the order of the table.
    supports : tuple of str
    distance : array, shape (N,)
        Of the predicted carried CoM from the measured line of gravity [m].
    force, moment : array, shape (N,)
        Size of the residual [N], [N m].
    mass, mass_sigma : float
        Of the whole robot as measured: what the sensors carry, and the model below the cuts [kg].
    """

    poses: tuple[int, ...]
    supports: tuple[str, ...]
    distance: Array
    force: Array
    moment: Array
    mass: float
    mass_sigma: float

    @property
    def com_rms(self) -> float:
        """Root mean square of the distances [m]."""
        return _rms(self.distance)

    @property
    def com_upper(self) -> float:
        """Upper 95 % end of its interval [m]."""
        return upper_95(self.com_rms, len(self.poses))

    @property
    def force_rms(self) -> float:
        """[N]."""
        return _rms(self.force)

    @property
    def moment_rms(self) -> float:
        """[N m]."""
        return _rms(self.moment)


def model_error(
    robot: Robot, table: PoseTable, tares: Mapping[str, Array] | None = None
) -> ModelError:
    """Predict every standing pose with a robot as it is described.

    Parameters
    ----------
    robot : Robot
        The model to be judged.
    table : PoseTable
        Its columns of angles are in the order of the robot's joints.
    tares : mapping from sensor to array, shape (6,), optional
        Offsets that the readings still have [N, N m].

    Returns
    -------
    ModelError
        Without any pose if the robot stands in none.

    Raises
    ------
    ConfigError, MissingColumnError, NotFiniteError, DataError
        If the wrench or the error of a loaded sensor is not known.
    """
    unknowns = unknowns_of(robot, offsets=tuple(tares or ()))
    theta = unknowns.cad
    for sensor, tare in (tares or {}).items():
        columns = unknowns.offset_columns(sensor)
        if columns is not None:
            theta[columns] = tare
    groups = [group for group in groups_of(robot, table) if not group.layout.hangs]
    found: list[tuple[int, Array]] = []
    for group in groups:
        errors = prediction_errors(robot, unknowns, group, theta)
        found += zip(group.rows, np.stack(errors, axis=1), strict=True)
    found.sort(key=lambda item: item[0])
    rows = [row for row, _ in found]
    values = np.array([error for _, error in found]).reshape(-1, 3)
    mass, mass_sigma = _measured_mass(robot, table) if rows else (np.nan, np.nan)
    return ModelError(
        poses=tuple(table.pose[row] for row in rows),
        supports=tuple(table.support[row] for row in rows),
        distance=values[:, 0],
        force=values[:, 1],
        moment=values[:, 2],
        mass=mass,
        mass_sigma=mass_sigma,
    )


def _measured_mass(robot: Robot, table: PoseTable) -> tuple[float, float]:
    """Return the weighted mean over poses of what is carried and what hangs below the cuts [kg].

    The sigma is that of the poses' own noise; an error of a tare is common to all and not in it.
    """
    found = balance_coefficients(robot, table)
    below = [
        float(robot.tree.masses[~carrier_of(robot, table.support[row]).carried].sum())
        for row in found.rows
    ]
    weight = found.mass_sigma**-2.0
    return float(weight @ (found.mass + below) / weight.sum()), float(weight.sum() ** -0.5)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
