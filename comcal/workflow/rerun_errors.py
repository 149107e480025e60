# SPDX-License-Identifier: Apache-2.0
"""How far a simulation is from what was measured, with a model as given and as extended."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from comcal.errors import RankError
from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import parity
from comcal.predict.torques import held_torques
from comcal.report.rerun import RerunGain, RerunMeasure
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import joint_motion
from comcal.statics.coefficients import (
    coefficients_jacobian,
    to_stance,
    total_wrench,
)
from comcal.statics.configurations import placed_in_stance
from comcal.statics.joint_slopes import joint_slopes
from comcal.statics.support import Carrier, carrier_of, loaded_wrenches
from comcal.statics.torque_rows import motor_torque_factors, readable_joints

RESAMPLES = 2000
LEAST = {"N": 1e-3, "N m": 1e-4, "m": 1e-6}
"""Least noise that errors are measured in: engines do not compute more exactly."""


@dataclass(frozen=True)
class Understood:
    """Measured and simulated readings of the same poses, as one model understands them.

    Parameters
    ----------
    assumed : Assumed
    measured, simulated : PoseTable
    angle_gap : float
        Largest difference between simulated and measured encoder readings [rad] or [m].
    """

    assumed: Assumed
    measured: PoseTable
    simulated: PoseTable
    angle_gap: float

    @property
    def robot(self) -> Robot:
        """The robot that is assumed."""
        return self.assumed.robot


@dataclass(frozen=True)
class _Kind:
    """What is compared: squared errors of every pose, and what noise alone would make of them.

    ``squares``, ``noise``: shape (N,), in the square of ``unit``; NaN where nothing was measured.
    """

    what: str
    unit: str
    squares: Array
    noise: Array


def measure_gain(
    given: Understood,
    extended: Understood,
    engine: str,
    notes: tuple[str, ...],
    rng: np.random.Generator,
) -> RerunGain:
    """Compare the errors of two models, with 95 % intervals by bootstrap over poses.

    Parameters
    ----------
    given, extended : Understood
        The same poses.
    engine : str
        Name and version.
    notes : tuple of str
    rng : numpy.random.Generator

    Raises
    ------
    RankError
        If the engine measures nothing that was measured, too.
    """
    pairs = list(zip(_kinds(given), _kinds(extended), strict=True))
    pairs = [(a, b) for a, b in pairs if np.isfinite(a.squares + b.squares).any()]
    if not pairs:
        raise RankError(
            "nothing that was measured is in the simulation, too",
            where=engine,
            next_step="engines have force sensors in the feet, no force plates",
        )
    poses = given.measured.pose
    draws = rng.integers(0, len(poses), (RESAMPLES, len(poses)), np.intp)
    whole = _measure("all of it", "times noise", *_together(pairs), 1.0, draws)
    return RerunGain(
        engine=engine,
        poses=poses,
        whole=whole,
        measures=tuple(
            _measure(b.what, b.unit, a.squares, b.squares, float(np.nanmean(b.noise)), draws)
            for a, b in pairs
        ),
        angle_gap=max(given.angle_gap, extended.angle_gap),
        notes=notes,
    )


def _together(pairs: Sequence[tuple[_Kind, _Kind]]) -> tuple[Array, Array]:
    """Return the mean squared errors of every pose in units of the noise, given and extended.

    The noise is that of the readings as the extended model understands them, for both alike.
    """
    scaled = np.array([(a.squares / _size(b), b.squares / _size(b)) for a, b in pairs])
    known = np.asarray(np.isfinite(scaled).all(axis=1), np.bool_)
    count = known.sum(axis=0)
    sums = np.where(known[:, None], scaled, 0.0).sum(axis=0)
    before, after = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
    return before, after


def _size(kind: _Kind) -> float:
    return max(float(np.nanmean(kind.noise)), LEAST[kind.unit] ** 2)


def _measure(
    what: str, unit: str, before: Array, after: Array, noise: float, draws: npt.NDArray[np.intp]
) -> RerunMeasure:
    known = np.asarray(np.isfinite(before + after), np.bool_)
    old, new = np.where(known, before, np.nan), np.where(known, after, np.nan)
    rms = [float(np.sqrt(np.nanmean(x))) for x in (old, new)]
    drawn_known = known[draws].sum(axis=1)
    some = drawn_known > 0
    means = [np.nansum(x[draws[some]], axis=1) / drawn_known[some] for x in (old, new)]
    fraction = 1.0 - means[1] / np.maximum(means[0], 1e-300)
    return RerunMeasure(
        what=what,
        unit=unit,
        given=rms[0],
        given_interval=_interval(np.sqrt(means[0])),
        extended=rms[1],
        extended_interval=_interval(np.sqrt(means[1])),
        noise=float(np.sqrt(noise)),
        gain=1.0 - rms[1] ** 2 / max(rms[0] ** 2, 1e-300),
        interval=_interval(fraction),
        poses=int(known.sum()),
    )


def _interval(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, [2.5, 97.5])
    return float(low), float(high)


def _kinds(of: Understood) -> tuple[_Kind, ...]:
    """Return what is compared of all poses."""
    n = len(of.measured)
    force, moment, line, torque = (np.full((2, n), np.nan) for _ in range(4))
    for support in sorted(set(of.measured.support)):
        index = np.flatnonzero([s == support for s in of.measured.support])
        carrier = carrier_of(of.robot, support)
        part = replace(of, measured=of.measured.select(index), simulated=of.simulated.select(index))
        error, cov, to_line = _wrench_errors(part, carrier)
        off = np.einsum("nij,nj->ni", to_line, error)
        force[0, index], moment[0, index] = (_square(error[:, s]) for s in (_FORCE, _MOMENT))
        force[1, index], moment[1, index] = (_trace(cov[:, s, s]) for s in (_FORCE, _MOMENT))
        line[0, index] = _square(off)
        line[1, index] = _trace(to_line @ cov @ np.swapaxes(to_line, 1, 2))
        torque[0, index], torque[1, index] = _torque_errors(part, carrier)
    return (
        _Kind("total foot force", "N", force[0], force[1]),
        _Kind("total foot moment", "N m", moment[0], moment[1]),
        _Kind("total CoM", "m", line[0], line[1]),
        _Kind("joint torques", "N m", torque[0], torque[1]),
    )


_FORCE, _MOMENT = slice(0, 3), slice(3, 6)


def _square(error: Array) -> Array:
    return np.sum(error**2, axis=1)


def _trace(cov: Array) -> Array:
    return np.einsum("nii->n", cov)


def _wrench_errors(of: Understood, carrier: Carrier) -> tuple[Array, Array, Array]:
    """Return how far the total foot wrench is off, and what that means for the line of gravity.

    Returns
    -------
    error : array, shape (N, 6)
        Measured less simulated, each about its own P [N, N m].
    cov : array, shape (N, 6, 6)
        From the errors of the readings: wrenches, tares left out, and encoders.
    to_line : array, shape (N, 2, 6)
        Takes the error to that of the line of gravity at the height of the CoM, x and y of P [m].
    """
    robot, measured = of.robot, of.measured
    totals: list[Array] = []
    for table in (measured, of.simulated):
        w, _ = loaded_wrenches(carrier, table)
        totals.append(total_wrench(carrier, placed_in_stance(robot, carrier, table.q), w))
    at = placed_in_stance(robot, carrier, measured.q)
    _, w_cov = loaded_wrenches(carrier, measured)
    X = to_stance(carrier, at)
    cov = np.einsum("nsij,nsjk,nslk->nil", X, w_cov, X, optimize=True)
    slopes = _by_angles(lambda table: _equilibrium(of.assumed, table), measured)
    cov += np.einsum("nij,nj,nkj->nik", slopes, measured.q_cov, slopes)
    Z = at.total_com()[:, 2]
    J = coefficients_jacobian(totals[0])
    to_line = np.stack([J[:, 0] + Z[:, None] * J[:, 1], J[:, 2] + Z[:, None] * J[:, 3]], axis=1)
    return totals[0] - totals[1], cov, to_line


def _equilibrium(assumed: Assumed, table: PoseTable) -> Array:
    """Return what is left of the balance of what the feet carry, about P, shape (N, 6)."""
    found = parity(assumed, table)
    mine = np.flatnonzero([row.kind == "equilibrium" for row in found.row])
    by_pose = mine[np.argsort(found.pose[mine], kind="stable")]
    return found.values[by_pose].reshape(len(table), 6)


def _by_angles(value: Callable[[PoseTable], Array], table: PoseTable) -> Array:
    """Return d(value)/dq of every pose, shape (N, ..., n_joints)."""

    def at(q: Array) -> Array:
        copies = np.tile(np.arange(len(table)), len(q) // len(table))
        return value(replace(table.select(copies), q=q))

    return joint_slopes(at, table.q)


def _torque_errors(of: Understood, carrier: Carrier) -> tuple[Array, Array]:
    """Return squared errors of the joint torques and those that noise makes, (N,) [(N m)^2].

    Of turning joints whose torque does not depend on how the feet share the load.
    """
    robot = of.robot
    chosen = _same_however_shared(robot, carrier)
    known = [_torques(robot, table)[:, chosen] for table in (of.measured, of.simulated)]
    error = known[0] - known[1]
    factor = motor_torque_factors(robot)
    measured = of.measured
    by_torque = np.isfinite(measured.torque)
    variance = np.where(by_torque, measured.torque_var, measured.current_var * factor**2)
    slopes = _by_angles(lambda table: _held(of.assumed, table, carrier), measured)
    variance = variance + np.einsum("nij,nj->ni", slopes**2, measured.q_cov)
    there = np.isfinite(error)
    some = there.any(axis=1)
    count = np.maximum(there.sum(axis=1), 1)
    squares = np.where(there, error, 0.0) ** 2
    noise = np.where(there, np.nan_to_num(variance[:, chosen]), 0.0)
    return (
        np.where(some, squares.sum(axis=1) / count, np.nan),
        np.where(some, noise.sum(axis=1) / count, np.nan),
    )


def _torques(robot: Robot, table: PoseTable) -> Array:
    by_current = table.current * motor_torque_factors(robot)
    return np.where(np.isfinite(table.torque), table.torque, by_current)


def _held(assumed: Assumed, table: PoseTable, carrier: Carrier) -> Array:
    """Return the joint torques under the load that the feet would have by the model, (N, nj)."""
    at = placed_in_stance(assumed.robot, carrier, table.q)
    X = to_stance(carrier, at)[:, 0]
    change = np.linalg.solve(X, _equilibrium(assumed, table)[:, :, None])[:, :, 0]
    first = carrier.sensors[0]
    wrench = {**table.wrench, first: table.wrench[first] - change}
    return np.nan_to_num(held_torques(assumed, replace(table, wrench=wrench)))


def _same_however_shared(robot: Robot, carrier: Carrier) -> npt.NDArray[np.intp]:
    """Return the turning joints that have all standing feet on one side."""
    tree, motion = robot.tree, joint_motion(robot.tree)
    feet = [tree.link_index[robot.feet[name].link] for name in carrier.feet]
    beyond = tree.descendants[motion.joint + 1][:, feet].sum(axis=1)
    split = ((beyond > 0) & (beyond < len(feet))) | motion.prismatic
    moved_by_split = (motion.drive != 0.0).astype(np.float64).T @ split
    return np.flatnonzero((moved_by_split == 0.0) & readable_joints(robot, carrier))
