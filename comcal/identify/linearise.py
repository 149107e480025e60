# SPDX-License-Identifier: Apache-2.0
"""The rows of a session, linearised: what a pose's inputs and the unknowns do to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.errors import DataError
from comcal.identify.groups import Group
from comcal.identify.unknowns import Unknowns
from comcal.robot.frames import apply
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import Balance
from comcal.statics.stance import stance_frame
from comcal.statics.static_rows import (
    Model,
    RowLayout,
    row_jacobian,
    row_regressor,
    row_residual,
)

SAME_FLOOR = 4.0
"""Force directions closer than this many standard deviations may belong to one floor."""
ROUNDING = 1e-12
"""The same for exact data."""
FEIGNED_POSES = 30
"""Number of poses from which on not each of them is asked what its errors feign."""
EXACT = 1e-12
"""Smallest eigenvalue of the rows' correlation matrix that can be inverted: what rounding makes."""


@dataclass(frozen=True)
class Linearised:
    """One group's rows at a linearisation point.

    Parameters
    ----------
    misclosure : array, shape (N, n_rows)
        Residual that remains at the measured inputs, to first order.
    A : array, shape (N, n_rows, size)
        With respect to the unknowns.
    B : array, shape (N, n_rows, n_inputs)
        With respect to the inputs.
    W : array, shape (N, n_rows, n_rows)
        Inverse covariance of the rows, apart from errors that all poses share.
    balance : Balance
        The point of linearisation.
    """

    misclosure: Array
    A: Array
    B: Array
    W: Array
    balance: Balance


def linearise(
    robot: Robot, unknowns: Unknowns, group: Group, theta: Array, inputs: Array
) -> Linearised:
    """Linearise the equations of one group at *theta* and (adjusted) *inputs*.

    Raises
    ------
    DataError
        If the stated errors leave a row, or a sum of rows, of some pose exact.
    """
    balance = group.balance_at(robot, inputs)
    model = model_at(unknowns, group, theta)
    wrenches, torques = group.others(inputs)
    B = row_jacobian(group.layout, balance, wrenches, model)
    W = _weights(B @ group.cov @ np.swapaxes(B, 1, 2), group)
    at_point = row_residual(group.layout, balance, wrenches, torques, model)
    away = without_offsets(unknowns, group, theta) - inputs
    misclosure = at_point + np.einsum("nij,nj->ni", B, away)
    A = regressor(balance, unknowns, balance.direction, group.layout, B)
    return Linearised(misclosure, A, B, W, balance)


def without_offsets(unknowns: Unknowns, group: Group, theta: Array) -> Array:
    """Return the measured inputs less the tares in *theta*, shape (N, n_inputs)."""
    inputs = group.inputs
    for sensor in unknowns.offsets:
        at, columns = group.layout.sensor_columns(sensor), unknowns.offset_columns(sensor)
        if at is not None and columns is not None:
            inputs[:, at] -= theta[columns]
    return inputs


def model_at(unknowns: Unknowns, group: Group, theta: Array) -> Model:
    """Return the model that theta stands for, as the poses of *group* see it."""
    return Model(
        mass=unknowns.mass(theta, group.carrier.carried),
        h=unknowns.moments(theta),
        masses=unknowns.link_masses(theta),
    )


def _weights(cov: Array, group: Group) -> Array:
    """Invert the covariance of every pose's rows, shape (N, n_rows, n_rows)."""
    sigma = np.sqrt(np.einsum("nii->ni", cov))
    unit = sigma[:, :, None] * sigma[:, None]
    correlation = np.divide(cov, unit, out=np.zeros_like(cov), where=unit > 0.0)
    smallest = np.linalg.eigvalsh(correlation)[:, 0]
    i = int(np.argmin(smallest))
    if not smallest[i] > EXACT:
        raise DataError(
            "the stated errors make a sum of forces and moments exact, which cannot be weighed",
            where=group.where[i],
            measured=f"smallest eigenvalue of the rows' correlation {smallest[i]:.1g}",
            limit=f"{EXACT:g}",
            next_step="check se.* and cov.* of its sensors, and noise in robot.yaml",
        )
    return np.asarray(np.linalg.inv(cov), np.float64)


def steady_regressor(linear: Linearised, unknowns: Unknowns, group: Group) -> Array:
    """Return the regressor as if poses on one floor had measured one direction of gravity."""
    direction = steady_directions(linear.balance, group.cov)
    return regressor(linear.balance, unknowns, direction, group.layout, linear.B)


def feigned_information(
    linear: Linearised, unknowns: Unknowns, group: Group, directions: Array
) -> Array:
    r"""Return the information that errors inside the regressor make up, along some directions.

    Parameters
    ----------
    directions : array, shape (size, k)
        Changes of theta.

    Returns
    -------
    array, shape (k,)
        Expectation of :math:`v^T dA^T W\, dA\, v` over the input errors. What an input does to
        A v is what it does to the rows of the model v, less those of an empty model. Of many
        poses some stand for all.
    """
    every = np.arange(len(group.rows))
    some = every[:: -(-len(every) // FEIGNED_POSES)]
    balance, W, cov = linear.balance.select(some), linear.W[some], group.cov[some]
    wrenches = group.others(group.inputs)[0][some]

    def by_inputs(v: Array) -> Array:
        model = model_at(unknowns, group, v)
        return row_jacobian(group.layout, balance, wrenches, model)

    empty = by_inputs(np.zeros(unknowns.size))
    found = np.zeros(directions.shape[1])
    for k, v in enumerate(directions.T):
        dB = by_inputs(v) - empty
        found[k] = np.sum((W @ dB @ cov) * dB)
    return found * len(every) / len(some)


def regressor(
    balance: Balance,
    unknowns: Unknowns,
    direction: Array,
    layout: RowLayout | None = None,
    B: Array | None = None,
) -> Array:
    """Return d(residual)/d(theta), shape (N, n_rows, size), for a given direction of gravity.

    Parameters
    ----------
    direction : array, shape (N, 3)
        Unit vector up in the root frame.
    layout : RowLayout, optional
        By default the balance of the whole robot alone.
    B : array, shape (N, n_rows, n_inputs), optional
        d(residual)/d(inputs); needed where tares are unknown.
    """
    layout = layout or RowLayout(balance.carrier, (), (), balance.q.shape[1])
    by_mass, by_moment = row_regressor(layout, balance, direction, unknowns.links)
    A = np.zeros((len(balance.q), layout.n_rows, unknowns.size))
    if unknowns.free_masses:
        A[:, :, : unknowns.n_masses] = by_mass
    elif layout.balance_rows:
        A[:, 0, 0] = -balance.robot.gravity
    moments = by_moment.reshape(*A.shape[:2], -1)
    A[:, :, unknowns.n_masses : unknowns.first_offset] = moments
    for sensor in unknowns.offsets:
        inputs, columns = layout.sensor_columns(sensor), unknowns.offset_columns(sensor)
        if B is not None and inputs is not None and columns is not None:
            A[:, :, columns] = -B[:, :, inputs]
    return A


def steady_directions(balance: Balance, cov: Array) -> Array:
    """Average the force direction over poses that may have stood on one floor, shape (N, 3).

    In the stance frame a floor leans the same way in every pose; poses whose directions differ by
    no more than their noise are averaged. Hanging poses keep their own.
    """
    if balance.up is not None:
        return balance.direction
    support = balance.carrier.support
    R_root_P, _ = stance_frame(balance.robot, support, balance.placements)
    in_P = np.einsum("nji,nj->ni", R_root_P, balance.direction)
    force = np.einsum("nsij,nsjk->nik", balance.X[:, :, :3, :], _sensor_roots(balance, cov))
    sigma = np.linalg.norm(force, axis=(1, 2)) / np.linalg.norm(balance.F, axis=1)
    apart = sum(np.subtract.outer(component, component) ** 2 for component in in_P.T)
    limit = SAME_FLOOR**2 * np.add.outer(sigma**2, sigma**2) + ROUNDING**2
    same = np.asarray(apart <= limit)
    mean = same.astype(np.float64) @ in_P
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    return apply(R_root_P, mean)


def _sensor_roots(balance: Balance, cov: Array) -> Array:
    """Return the standard deviation of each loaded wrench as columns, (N, n_sensors, 6, 6)."""
    n, n_sensors = balance.wrench_each.shape[:2]
    variance = np.einsum("nii->ni", cov)[:, : 6 * n_sensors].reshape(n, n_sensors, 6)
    return np.sqrt(variance)[..., None] * np.eye(6)
