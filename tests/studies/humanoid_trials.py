# SPDX-License-Identifier: Apache-2.0
"""Calibrations of humanoids that stood in an engine: noise on top, errors against the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from free_mass_bound import Stood as BoundPose
from free_mass_bound import information, skeleton_of
from humanoid_engine import Stood, table_of, true_theta, ups
from scipy.linalg import qr

from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.scope import Scope, scoped
from comcal.identify.solution import total_com_functional
from comcal.identify.unknowns import Unknowns, unknowns_of
from comcal.measure.table import PoseTable
from comcal.plan.candidates import Pool
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.stance import stance_frame
from comcal.statics.support import carrier_of

NOISE = (0.1, 0.01, 3e-4, 0.5)
"""Standard errors of a pose mean: forces [N], moments [N m], angles [rad], joint torques [N m]."""

TIE = 1e-3
"""Shares seen of two unknowns that differ by less are equal: rounding must not choose."""


@dataclass(frozen=True)
class HeldOut:
    """Balanced poses that nobody calibrated with, and where the engine says the CoM is.

    Parameters
    ----------
    poses : Pool
    com : array, shape (N, 3)
        Of the whole true robot, in P [m].
    """

    poses: Pool
    com: Array


@dataclass(frozen=True)
class Calibrations:
    """Calibrations of one robot with one set of poses.

    Parameters
    ----------
    names : tuple of str, length n
        Unknown that leads each identifiable combination.
    error, sigma : array, shape (D, n)
        Of every combination in every draw of noise, in units of its Cramer-Rao bound.
    rank : array of int, shape (D,)
    chi2, dof : array, shape (D,)
    com : array, shape (D, 3)
        Root mean square error of the predicted CoM over held-out poses, along the axes of P [m].
    """

    names: tuple[str, ...]
    error: Array
    sigma: Array
    rank: Array
    chi2: Array
    dof: Array
    com: Array


def held_out_of(robot: Robot, poses: Pool, com: Array) -> HeldOut:
    """Bring the engine's CoMs from the root frame to P."""
    at = place_links(robot.tree, poses.q)
    in_P = np.empty_like(com)
    for support in set(poses.support):
        rows = np.flatnonzero([s == support for s in poses.support])
        R, p = stance_frame(robot, support, at)
        in_P[rows] = np.einsum("nji,nj->ni", R[rows], com[rows] - p[rows])
    return HeldOut(poses, in_P)


def com_prediction(unknowns: Unknowns, held_out: HeldOut) -> Callable[[Array], Array]:
    """Return what turns a theta into errors of predicted CoMs in P, shape (N, 3) [m]."""
    poses = held_out.poses
    parts = list[tuple[Array, Array, Array, Array]]()
    for support in sorted(set(poses.support)):
        rows = np.flatnonzero([s == support for s in poses.support])
        carrier = carrier_of(unknowns.robot, support)
        parts.append((rows, *total_com_functional(unknowns, carrier, poses.q[rows], whole=True)))

    def errors(theta: Array) -> Array:
        left = -held_out.com
        for rows, L, known, root in parts:
            left[rows] += root + (L @ theta + known) / unknowns.mass(theta)
        return left

    return errors


def calibrate(
    robot: Robot,
    true: Robot,
    stood: Stood,
    held_out: HeldOut,
    scope: Scope,
    draws: list[np.random.Generator],
) -> Calibrations:
    """Calibrate the nominal robot once for every generator.

    Combinations are judged with free masses only: with masses taken from a URDF that is wrong,
    what is found of a link is not its own moment.
    """
    exact = table_of(robot, stood, NOISE)
    unknowns, groups = scoped(robot, exact, scope)
    at_truth = adjust(robot, unknowns, groups)
    theta = true_theta(unknowns, true)
    names, L = base_parameters(at_truth) if scope.free_masses else ((), np.zeros((0, len(theta))))
    bound = np.zeros(0)
    if names:
        F = information_of(unknowns, stood, theta, NOISE[3] if scope.torques else None)
        bound = bounds_of(at_truth, F, L)
    errors = com_prediction(unknowns, held_out)
    found = list[tuple[Array, Array, int, float, int, Array]]()
    for rng in draws:
        _, noisy_groups = scoped(robot, noisy(exact, rng), scope)
        fit = adjust(robot, unknowns, noisy_groups)
        sigma = np.sqrt(np.einsum("ij,jk,ik->i", L, fit.cov, L))
        com = np.sqrt(np.mean(errors(fit.theta) ** 2, axis=0))
        error = L @ (fit.theta - theta)
        found.append((error / bound, sigma / bound, fit.rank, fit.chi2, fit.dof, com))
    columns = list(zip(*found, strict=True))
    return Calibrations(names, *(np.array(column) for column in columns))


def nominal_com(robot: Robot, held_out: HeldOut) -> Array:
    """Return the root mean square error of the CoM that the URDF predicts, shape (3,) [m]."""
    unknowns = unknowns_of(robot, free_masses=True)
    errors = com_prediction(unknowns, held_out)(unknowns.cad)
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def base_parameters(fit: Adjustment) -> tuple[tuple[str, ...], Array]:
    """Return combinations that span what the poses determine, one for each leading unknown.

    Returns
    -------
    names : tuple of str, length rank
    L : array, shape (rank, size)
        The leading unknown, plus the others' shares that statics merges with it.
    """
    rows = fit.seen.T
    # Of unknowns that are seen equally well, the one nearest to the root leads.
    first = 1.0 - TIE * np.arange(rows.shape[1]) / rows.shape[1]
    _, _, order = qr(rows * first, mode="economic", pivoting=True)
    lead = np.sort(order[: fit.rank])
    scale = fit.unknowns.scale
    L = np.linalg.solve(rows[:, lead], rows) / scale * scale[lead][:, None]
    return tuple(fit.unknowns.names[i] for i in lead), L


def information_of(
    unknowns: Unknowns, stood: Stood, theta: Array, torque_sigma: float | None
) -> Array:
    """Return the information of the poses at the truth, by the oracle, shape (size, size)."""
    robot = unknowns.robot
    bones = skeleton_of(robot, unknowns.links)
    return information(bones, bound_poses(robot, stood), theta, NOISE[:3], torque_sigma)


def bound_poses(robot: Robot, stood: Stood) -> list[BoundPose]:
    """Return the poses as the oracle wants them."""
    sensors = list(robot.sensors)
    poses = list[BoundPose]()
    for i, support in enumerate(stood.support):
        loaded = carrier_of(robot, support).sensors
        first = stood.wrench[i][sensors.index(loaded[0])]
        poses.append(BoundPose(loaded, stood.q[i], ups(stood)[i], first))
    return poses


def bounds_of(fit: Adjustment, F: Array, L: Array) -> Array:
    """Return the Cramer-Rao bound of combinations, what no pose shows held where it is, (n,)."""
    D = fit.unknowns.scale[:, None] * fit.seen
    spread = L @ D
    return np.asarray(np.sqrt(np.sum(spread * np.linalg.solve(D.T @ F @ D, spread.T).T, axis=1)))


def noisy(table: PoseTable, rng: np.random.Generator) -> PoseTable:
    """Return a table with fresh errors of the stated size."""
    force, moment, encoder, torque = NOISE
    six = np.repeat([force, moment], 3)
    return replace(
        table,
        q=table.q + encoder * rng.standard_normal(table.q.shape),
        wrench={s: w + six * rng.standard_normal(w.shape) for s, w in table.wrench.items()},
        torque=table.torque + torque * rng.standard_normal(table.torque.shape),
    )
