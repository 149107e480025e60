# SPDX-License-Identifier: Apache-2.0
r"""Least squares over every pose of a session, errors in all variables.

The rows of :mod:`comcal.statics.static_rows` hold between *true* wrenches, angles and torques.
Measured ones carry errors of known covariance, and one wrench's noise enters the force row, all
moment rows and every torque row of its leg, one encoder's noise all moment and torque rows: a
Gauss-Helmert adjustment weighs every pose with the full covariance :math:`B \Sigma B^T` of its rows
and evaluates the regressor at the adjusted inputs. Evaluating it at the measured ones would pull
weakly seen directions towards zero, because the same error then sits in the regressor and in the
residual.

The error of a sensor's tare is one and the same in every pose, and so is that of a torque constant.
Such errors join the covariance of all rows as :math:`C C^T`, C the rows' reaction to them in units
of their standard deviations, and are inverted with it by Woodbury's formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.errors import RankError
from comcal.identify.groups import Group
from comcal.identify.linearise import (
    Linearised,
    feigned_information,
    linearise,
    steady_regressor,
    without_offsets,
)
from comcal.identify.shared_errors import over_poses, row_errors
from comcal.identify.unknowns import Unknowns
from comcal.robot.model import Robot
from comcal.robot.tree import Array

ITERATIONS = 8
"""Gauss-Helmert steps at most; three or four suffice for noise of a few per mille. Only data that
the model does not explain take more, and then the misfit says so."""
CONVERGED = 1e-3
"""Largest step that ends the iteration, in standard deviations of the unknowns: the last one taken,
or the next one, were it smaller than the last by the factor by which that was smaller."""
NOISE_RATIO = 20.0
"""A direction counts as seen when the information on it exceeds that which the errors of angles and
force directions alone would feign by this factor."""
RELATIVE_RANK = 1e-7
"""Smallest singular value counted, relative to the largest: what rounding alone can make."""


@dataclass(frozen=True)
class Adjustment:
    """Result of the adjustment, restricted to the directions that the poses determine.

    Parameters
    ----------
    theta : array, shape (size,)
        Best estimate; along ``unseen`` it keeps the URDF's value and is *not* measured.
    seen : array, shape (size, rank)
        Orthonormal basis, in scaled unknowns, of what the poses determine; best seen first.
    unseen : array, shape (size, size - rank)
        Basis of the rest.
    singular : array, shape (rank,)
        Square roots of the information on each seen direction (scaled unknowns).
    cov : array, shape (size, size)
        Covariance of theta from measurement noise alone, that of the tares included.
    cov_cad : array, shape (size, size)
        What the URDF's own tolerances add along the unseen directions.
    sensitivity : tuple of array, one per group, each shape (N, size, n_inputs)
        d theta / d inputs. A change of a tare is a change of that sensor in all poses.
    residuals : tuple of array, one per group, each shape (N, n_rows)
        What is left of forces [N], moments and torques [N m], in the order of its layout.
    chi2, dof
        Weighted sum of squared residuals and its degrees of freedom.
    iterations : int
        Steps taken.
    """

    unknowns: Unknowns
    groups: tuple[Group, ...]
    theta: Array
    seen: Array
    unseen: Array
    singular: Array
    cov: Array
    cov_cad: Array
    sensitivity: tuple[Array, ...]
    residuals: tuple[Array, ...]
    chi2: float
    dof: int
    iterations: int

    @property
    def rank(self) -> int:
        """Number of directions that the poses determine."""
        return self.seen.shape[1]

    @property
    def condition(self) -> float:
        """Ratio of the best to the worst seen singular value (scaled unknowns)."""
        return float(self.singular[0] / self.singular[-1]) if self.rank else np.inf

    def visibility(self, functional: Array) -> Array:
        """Return which share of linear functionals of theta lies in the unseen directions.

        Parameters
        ----------
        functional : array, shape (..., size)
            Rows L of ``L theta``.

        Returns
        -------
        share : array, shape (...)
            0: fully measured; 1: not measured at all.
        """
        scaled = functional * self.unknowns.scale
        hidden = np.linalg.norm(scaled @ self.unseen, axis=-1)
        whole = np.linalg.norm(scaled, axis=-1)
        return np.divide(hidden, whole, out=np.zeros_like(hidden), where=whole > 0)


def adjust(robot: Robot, unknowns: Unknowns, groups: Sequence[Group]) -> Adjustment:
    """Adjust every pose at once.

    Raises
    ------
    RankError
        If there is no pose at all in which a sensor is loaded.
    DataError
        If the stated errors leave a pose exact in some direction.
    """
    groups = tuple(groups)
    if not groups:
        raise RankError(
            "no pose in which a foot with a sensor stands, and no torque that statics explains",
            next_step="record poses with support 'double' or one foot",
        )
    theta, scale = unknowns.cad, unknowns.scale
    inputs = [group.inputs for group in groups]
    basis: tuple[Array, Array] | None = None
    iterations, size = 0, 0.0
    while True:
        iterations += 1
        linear = [
            linearise(robot, unknowns, group, theta, x)
            for group, x in zip(groups, inputs, strict=True)
        ]
        # What the poses can show does not depend on what they show: decided once.
        basis = basis or _seen_directions(linear, unknowns, groups)
        errors = row_errors(groups, linear)
        A = [a.A for a in linear]
        weighted = errors.weighted(A)
        seen, singular = _by_singular_value(basis[0], over_poses(weighted, A), scale)
        unseen = basis[1]
        right = -over_poses(weighted, [a.misclosure[:, :, None] for a in linear])[:, 0]
        to_theta = (scale[:, None] * seen / singular**2) @ (seen.T * scale)
        step = to_theta @ right
        theta = theta + step
        left = [a.misclosure + a.A @ step for a in linear]
        weighted_left = [x[:, :, 0] for x in errors.weighted([r[:, :, None] for r in left])]
        measured = [without_offsets(unknowns, group, theta) for group in groups]
        inputs = errors.adjusted_inputs(measured, weighted_left)
        before, size = (
            size,
            float(np.max(np.abs(singular * (seen.T @ (step / scale))), initial=0.0)),
        )
        if iterations >= ITERATIONS or size < CONVERGED or size * size < CONVERGED * before:
            break
    hidden = scale[:, None] * unseen
    cad = (unseen.T * (unknowns.cad_sigma / scale) ** 2) @ unseen
    return Adjustment(
        unknowns=unknowns,
        groups=groups,
        theta=theta,
        seen=seen,
        unseen=unseen,
        singular=singular,
        cov=to_theta,
        cov_cad=hidden @ cad @ hidden.T,
        sensitivity=tuple(
            -np.swapaxes(_turned(G, to_theta), 1, 2) @ a.B
            for G, a in zip(weighted, linear, strict=True)
        ),
        residuals=tuple(left),
        chi2=sum(float(np.sum(r * x)) for r, x in zip(left, weighted_left, strict=True)),
        dof=sum(g.layout.n_rows * len(g.rows) for g in groups) - seen.shape[1],
        iterations=iterations,
    )


def _turned(rows: Array, symmetric: Array) -> Array:
    """Return ``rows @ symmetric`` in one product over all poses, shape (N, n_rows, size)."""
    return (rows.reshape(-1, rows.shape[2]) @ symmetric).reshape(rows.shape)


def _seen_directions(
    linear: Sequence[Linearised], unknowns: Unknowns, groups: Sequence[Group]
) -> tuple[Array, Array]:
    """Split the scaled unknowns into seen and unseen directions."""
    scales = np.outer(unknowns.scale, unknowns.scale)
    structure = np.zeros_like(scales)
    for a, group in zip(linear, groups, strict=True):
        A = steady_regressor(a, unknowns, group)
        structure += scales * over_poses([a.W @ A], [A])
    value, vector = np.linalg.eigh(structure)
    is_seen = value > RELATIVE_RANK**2 * value[-1]
    weak = np.flatnonzero(is_seen & (value < _surely_seen(groups) * value[-1]))
    noise = np.zeros(len(weak))
    for a, group in zip(linear, groups, strict=True):
        directions = unknowns.scale[:, None] * vector[:, weak]
        noise += feigned_information(a, unknowns, group, directions)
    is_seen[weak] = value[weak] > NOISE_RATIO * noise
    return vector[:, is_seen], vector[:, ~is_seen]


def _surely_seen(groups: Sequence[Group]) -> float:
    """Return the share of the largest information above which a direction cannot be feigned.

    An input's error turns some part of the rows by an angle, and feigns at most the square of that
    angle of the largest information; all inputs together, their number times as much.
    """
    largest = 0.0
    for group in groups:
        q = np.einsum("nii->ni", group.cov)[:, group.layout.q_columns].max(initial=0.0)
        force = np.linalg.norm(group.w[..., :3].sum(axis=1), axis=1)
        noise = np.einsum("nii->ni", group.cov)[:, : group.layout.q_columns.start]
        relative = noise.max(axis=1, initial=0.0) / np.maximum(force, 1e-9) ** 2
        tilt = 0.0 if group.layout.hangs else float(relative.max(initial=0.0))
        largest = max(largest, group.layout.n_inputs * (float(q) + tilt))
    return min(1.0, NOISE_RATIO * largest) if largest else 0.0


def _by_singular_value(seen: Array, information: Array, scale: Array) -> tuple[Array, Array]:
    """Turn the basis of seen directions so that each has its own singular value, best first."""
    scaled = seen * scale[:, None]
    value, turn = np.linalg.eigh(scaled.T @ information @ scaled)
    return seen @ turn[:, ::-1], np.sqrt(value[::-1])
