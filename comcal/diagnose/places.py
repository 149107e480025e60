# SPDX-License-Identifier: Apache-2.0
r"""Where something acts that the catalogue has no name for.

A place (an encoder, a current, a sensor, a link's first moment, the floor) is given a free value in
every pose, normal with some standard deviation F: whatever function it is of, it can only show in
the rows that follow that place. With columns A of these values, one block per pose, and the
covariance C of noise, healthy spread and causes, the log odds are

.. math:: \tfrac12 F^2 b^T M^{-1} b - \tfrac12 \ln\det M, \qquad
    M = 1 + F^2 A^T C^{-1} A, \quad b = A^T C^{-1} r .

The price of a free value in every pose is high, so a place is found only where no function with a
few numbers does as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

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
    healthy = _Healthy.of(scene, scene.of.spread(scene.scales, named.causes))
    for spot in _spots(scene):
        odds = healthy.log_odds(scene.by.turned(spot.columns))
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
class _Healthy:
    """Whitened residuals against noise and the spread of everything known.

    Parameters
    ----------
    slices : tuple of slice
        Rows of each pose.
    r : array, shape (m,)
        Whitened by noise.
    H : array, shape (q, m)
        With which C^-1 = 1 - H^T H after whitening by noise.
    """

    slices: tuple[slice, ...]
    r: Array
    H: Array

    @classmethod
    def of(cls, scene: Scene, spread: Array) -> _Healthy:
        at = np.flatnonzero(spread)
        T = scene.X[:, at] * spread[at]
        L = cholesky(np.eye(at.size) + T.T @ T, lower=True, check_finite=False)
        H = solve_triangular(L, T.T, lower=True, check_finite=False)
        return cls(scene.by.slices, scene.r, H)

    def log_odds(self, A: Array) -> float:
        """Return the log odds of values that are free in every pose, of the likeliest size.

        Parameters
        ----------
        A : array, shape (m, k)
            What values of a fault's size do in their own pose, whitened by noise.
        """
        parts = [part for part in self.slices if A[part].any()]
        if not parts:
            return -np.inf
        k = A.shape[1]
        free = np.zeros((len(A), k * len(parts)))
        for n, part in enumerate(parts):
            free[part, n * k : (n + 1) * k] = A[part]
        across = self.H @ free
        K = free.T @ free - across.T @ across
        b = free.T @ self.r - across.T @ (self.H @ self.r)
        found = list[float]()
        for F in SIZES:
            M = np.eye(len(b)) + F**2 * K
            taken = F**2 * float(b @ np.linalg.solve(M, b))
            found.append(0.5 * (taken - float(np.linalg.slogdet(M)[1])))
        return max(found)


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
