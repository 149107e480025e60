# SPDX-License-Identifier: Apache-2.0
r"""Where something acts that the catalogue has no name for.

A place (an encoder, a current, a sensor, a link's first moment, the floor) is given a free value in
every pose, normal with some standard deviation F: whatever function it is of, it can only show in
the rows that follow that place. With A_p the whitened columns of the place in pose p, and T those
of healthy spread and causes, the covariance is block diagonal but for T; inverse and determinant
need, per pose,

.. math:: M_p = 1 + F^2 A_p^T A_p, \qquad Z_p = F M_p^{-1/2} A_p^T [T, r] .

The price of a free value in every pose is high, so a place is found only where no function with a
few numbers does as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from comcal.diagnose.diagnosis import Place
from comcal.diagnose.follows import ENOUGH, companion
from comcal.diagnose.naming import Named
from comcal.diagnose.readings import layout_of
from comcal.diagnose.scene import Scene
from comcal.measure.table import PoseTable
from comcal.robot.tree import Array

SIZES = (0.1, 0.3, 1.0)
"""Standard deviations that are tried, as shares of a fault."""
FOLLOWS = 0.7
"""Correlation from which free values are said to be a function of something."""
FAULTS = {"encoder": 0.02, "current": 1.0, "link moment": 0.5, "floor": 0.01, "IMU": 0.1}
SENSOR_FAULT = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 2.0])


@dataclass(frozen=True)
class _Spot:
    """One place.

    Parameters
    ----------
    place, target : str
    columns : array, shape (n, k)
        What a free value of a fault's size adds to the residuals of its own pose.
    """

    place: str
    target: str
    columns: Array


def place_of(named: Named) -> Place | None:
    """Return the place at which a free value in every pose explains most; None: nowhere.

    Parameters
    ----------
    named : Named
        Causes named may be there beside it.
    """
    scene = named.scene
    best: Place | None = None
    known = _Known.of(scene, scene.of.spread(scene.scales, named.causes))
    base = known.log_likelihood(np.zeros((len(scene.r), 1)))
    for spot in _spots(scene):
        A = scene.by.turned(spot.columns)
        odds = max(known.log_likelihood(size * A) for size in SIZES) - base
        if odds > 0.0 and (best is None or odds > best.log_odds):
            best = Place(spot.place, spot.target, _followed(scene, spot), odds)
    return best


def _spots(scene: Scene) -> Iterator[_Spot]:
    robot, at = scene.at.assumed.robot, layout_of(scene.at.table)
    joints = robot.tree.joint_names
    slopes = -scene.at.slopes
    for k, joint in enumerate(joints):
        yield _Spot("encoder", joint, FAULTS["encoder"] * slopes[:, [k]])
    for k, joint in enumerate(joints):
        columns = FAULTS["current"] * slopes[:, [at.joints + k]]
        if columns.any():
            yield _Spot("current", joint, columns)
    for sensor in at.sensors:
        yield _Spot("sensor", sensor, slopes[:, at.wrench(sensor)] * SENSOR_FAULT)
    first = 3 * at.joints
    if slopes[:, first : first + 3].any():
        yield _Spot("IMU", "", FAULTS["IMU"] * slopes[:, first : first + 3])
    for k, link in enumerate(robot.tree.links):
        if link.mass > 0.0:
            moments = FAULTS["link moment"] * scene.at.links.by_weight[:, k, 1:]
            yield _Spot("link moment", link.name, moments)
    if robot.feet:
        floor = np.stack([scene.at.sloped(i) for i in range(2)], axis=1)
        closing = np.stack(
            [
                np.array([float(r.kind == "closure" and r.axis == axis) for r in scene.at.at.row])
                for axis in ("roll", "pitch", "height")
            ],
            axis=1,
        )
        both = np.concatenate([floor, closing], axis=1)
        yield _Spot("floor", "", FAULTS["floor"] * both)


@dataclass(frozen=True)
class _Known:
    """What noise, healthy spread and causes say of the whitened residuals.

    Parameters
    ----------
    slices : tuple of slice
        Rows of each pose.
    T : array, shape (m, q)
        Columns of all that may be there, times its spread, whitened by noise.
    r : array, shape (m,)
    K : array, shape (q, q)
        1 + T^T T.
    b : array, shape (q,)
        T^T r.
    """

    slices: tuple[slice, ...]
    T: Array
    r: Array
    K: Array
    b: Array

    @classmethod
    def of(cls, scene: Scene, spread: Array) -> _Known:
        at = np.flatnonzero(spread)
        T = scene.X[:, at] * spread[at]
        return cls(scene.by.slices, T, scene.r, np.eye(at.size) + T.T @ T, T.T @ scene.r)

    def log_likelihood(self, A: Array) -> float:
        """Return ln p(residuals) with values that are normal and free in every pose.

        Parameters
        ----------
        A : array, shape (m, k)
            What one standard deviation of the values does in their own pose, whitened by noise.
        """
        determinant = 0.0
        parts, right = [self.T[:0]], [self.r[:0]]
        for mine in self.slices:
            a = A[mine]
            if a.any():
                L = np.linalg.cholesky(np.eye(a.shape[1]) + a.T @ a)
                determinant += 2.0 * float(np.log(np.diag(L)).sum())
                both = np.linalg.solve(L, a.T @ np.column_stack([self.T[mine], self.r[mine]]))
                parts.append(both[:, :-1])
                right.append(both[:, -1])
        Z, z = np.concatenate(parts), np.concatenate(right)
        L = np.linalg.cholesky(self.K - Z.T @ Z)
        determinant += 2.0 * float(np.log(np.diag(L)).sum())
        half = solve_triangular(L, self.b - Z.T @ z, lower=True, check_finite=False)
        chi2 = float(self.r @ self.r - z @ z - half @ half)
        return -0.5 * (chi2 + determinant)


def _followed(scene: Scene, spot: _Spot) -> str:
    """Return in words what the free values of the poses go along with."""
    values: list[Array] = []
    index: list[int] = []
    A = scene.by.turned(spot.columns)
    for pose, mine in enumerate(scene.by.slices):
        a = A[mine]
        if a.any():
            M = np.eye(a.shape[1]) + a.T @ a
            values.append(np.linalg.solve(M, a.T @ scene.r[mine]))
            index.append(pose)
    if len(values) < ENOUGH:
        return "of too few poses to say of what"
    found = np.array(values)
    column = found[:, int(np.argmax(np.var(found, axis=0)))]
    others = _companions(scene, spot, scene.at.table.select(index))
    return companion(column, others, FOLLOWS) or "other than those that were tried"


def _companions(scene: Scene, spot: _Spot, table: PoseTable) -> Iterator[tuple[str, Array]]:
    joints = scene.at.assumed.robot.tree.joint_names
    if spot.place in ("encoder", "current") and spot.target in joints:
        for name, v in _waves(table.q[:, joints.index(spot.target)]):
            yield f"of {name} of its own angle", v
    if spot.place == "sensor":
        force = table.wrench[spot.target][:, 2]
        yield "of its load", force
        yield "of the square of its load", force**2
    if spot.place == "link moment":
        for k, joint in enumerate(joints):
            for name, v in _waves(table.q[:, k]):
                yield f"of {name} of {joint}", v
    yield "of the time", table.t


def _waves(angle: Array) -> Iterator[tuple[str, Array]]:
    yield "the sine", np.sin(angle)
    yield "the cosine", np.cos(angle)
    yield "the double sine", np.sin(2.0 * angle)
    yield "the double cosine", np.cos(2.0 * angle)
