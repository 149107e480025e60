# SPDX-License-Identifier: Apache-2.0
"""What the causes are worth: poses predicted that took no part in finding their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri, stdtrit

from comcal.diagnose.diagnosis import Gain, HeldOut
from comcal.diagnose.evidence import whole
from comcal.diagnose.metric import Products, metric, products
from comcal.diagnose.naming import Named
from comcal.diagnose.scene import Scene
from comcal.robot.tree import Array

FOLDS = 5
LEAST_POSES = 6
CONFIDENCE = 0.95
Z = float(ndtri(0.5 + CONFIDENCE / 2))


@dataclass(frozen=True)
class Gains:
    """Held-out errors before and after.

    Parameters
    ----------
    of_cause : tuple of Gain
        In the order of the causes named; each against the same model without it.
    before, after : float
        Whitened mean squares of all held-out poses; 1 is noise and healthy spread.
    quantities : tuple of HeldOut
        In units people use.
    """

    of_cause: tuple[Gain, ...]
    before: float
    after: float
    quantities: tuple[HeldOut, ...]


def gains(named: Named) -> Gains | None:
    """Cross-validate the causes over poses; None where there are too few poses.

    Parameters are fitted without the fold, linearised about all poses; choosing the causes is not
    repeated.
    """
    scene, causes = named.scene, named.causes
    poses = np.unique(scene.by.pose)
    if len(poses) < LEAST_POSES or not causes:
        return None
    fold_of = _folds(scene, poses)
    sets = [causes, *(tuple(c for c in causes if c != i) for i in causes), ()]
    raw_left = [_nominal(scene, named) for _ in sets]
    for fold in range(FOLDS):
        held = np.isin(scene.by.pose, poses[fold_of == fold])
        train = scene.products - products(scene.X[held], scene.r[held])
        rows = np.isin(scene.at.at.pose, poses[fold_of == fold])
        for k, some in enumerate(sets):
            x = _fitted(scene, train, some)
            raw_left[k][rows] -= (scene.raw @ x)[rows]
    errors = [_by_pose(scene, left) for left in raw_left]
    rows = np.array([len(r) for r in scene.by.rows])
    return Gains(
        tuple(
            _gain(errors[1 + k], errors[0], _by_pose(scene, raw_left[1 + k] - raw_left[0]))
            for k in range(len(causes))
        ),
        float(errors[-1].sum() / rows.sum()),
        float(errors[0].sum() / rows.sum()),
        _quantities(scene, raw_left[-1], raw_left[0]),
    )


def _folds(scene: Scene, poses: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Deal the poses of every support out to the folds in turn."""
    order = np.argsort([scene.at.table.support[pose] for pose in poses], kind="stable")
    found = np.zeros(len(poses), np.intp)
    found[order] = np.arange(len(poses)) % FOLDS
    return found


def _nominal(scene: Scene, named: Named) -> Array:
    """Return the residuals of the model as given that belong to the linearised causes, (n,)."""
    left = np.zeros(scene.by.n)
    for rows, root, mine in zip(scene.by.rows, scene.by.roots, _split(scene, scene.r), strict=True):
        left[rows] = root @ mine
    return left


def _split(scene: Scene, whitened: Array) -> list[Array]:
    return np.split(whitened, np.cumsum([len(rows) for rows in scene.by.rows])[:-1])


def _fitted(scene: Scene, train: Products, causes: Sequence[int]) -> Array:
    """Return all coordinates, zero but for the causes, shape (p,)."""
    x = np.zeros(len(scene.of.fault))
    if causes:
        at = np.concatenate(
            [np.arange(scene.of.slices[i].start, scene.of.slices[i].stop) for i in causes]
        )
        against = metric(train, scene.of.spread(scene.scales))
        x[at] = whole(scene.of, tuple(causes), against).coordinates
    return x


def _by_pose(scene: Scene, left: Array) -> Array:
    """Return r^T C^-1 r of every pose by itself, shape (N,)."""
    spread = scene.of.spread(scene.scales)
    at = np.flatnonzero(spread)
    white = scene.by.turned(left)
    found: list[float] = []
    for rows, mine in zip(scene.by.rows, scene.by.slices, strict=True):
        T = scene.X[mine][:, at] * spread[at]
        C = T @ T.T + np.eye(len(rows))
        found.append(float(white[mine] @ np.linalg.solve(C, white[mine])) if len(rows) else 0.0)
    return np.array(found)


def _gain(before: Array, after: Array, shift: Array) -> Gain:
    """Return the share removed, and its interval.

    At these poses the gain is d^T C^-1 (2 r - d), d what the cause changes and r what is left
    without it: noise in r makes its standard deviation 2 |d|. Its scatter over poses would only
    say that some poses show the cause and others do not.

    Parameters
    ----------
    before, after, shift : array, shape (N,)
        Squared norms of r, r - d and d, pose by pose.
    """
    scale = float(before.sum()) or 1.0
    gained = float((before - after).sum())
    half = Z * 2.0 * float(np.sqrt(shift.sum()))
    # Noise may let it look like more, but nobody gains more than all there is.
    return Gain(gained / scale, ((gained - half) / scale, min((gained + half) / scale, 1.0)))


def _interval(values: Array) -> tuple[float, float]:
    n = len(values)
    mean = float(values.mean())
    half = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2) * values.std(ddof=1) / np.sqrt(n))
    return mean - half, mean + half


def _quantities(scene: Scene, before: Array, after: Array) -> tuple[HeldOut, ...]:
    """Return root mean squares in units, with the interval of what was gained over poses."""
    valid = np.zeros(scene.by.n, np.bool_)
    valid[scene.by.used] = True
    robot = scene.at.assumed.robot
    weight = float(robot.tree.masses.sum()) * robot.gravity
    rows = scene.at.at.row
    kinds = {
        "foot force": ("N", 1.0, [r.kind == "equilibrium" and r.axis[0] == "F" for r in rows]),
        "foot moment": ("N m", 1.0, [r.kind == "equilibrium" and r.axis[0] == "M" for r in rows]),
        "CoM": (
            "mm",
            1e3 / weight,
            [r.kind == "equilibrium" and r.axis in ("Mx", "My") for r in rows],
        ),
        "joint torque": ("N m", 1.0, [r.kind == "torque" for r in rows]),
    }
    found: list[HeldOut] = []
    for name, (unit, factor, mine) in kinds.items():
        chosen = np.array(mine, np.bool_) & valid
        if chosen.any():
            found.append(_held_out(name, unit, factor, scene.at.at.pose, chosen, before, after))
    return tuple(found)


def _held_out(
    name: str,
    unit: str,
    factor: float,
    pose: npt.NDArray[np.intp],
    chosen: npt.NDArray[np.bool_],
    before: Array,
    after: Array,
) -> HeldOut:
    poses = np.unique(pose[chosen])
    # Of moments about two axes the CoM's distance is the sum of squares; of others the mean.
    per = 2.0 if name == "CoM" else 1.0
    squares = [
        np.array([np.mean((factor * left[chosen & (pose == p)]) ** 2) * per for p in poses])
        for left in (before, after)
    ]
    interval = (float("nan"), float("nan"))
    if len(poses) > 1:
        a, b = (np.sqrt(s) for s in squares)
        interval = _interval(a - b)
    return HeldOut(
        name, unit, float(np.sqrt(squares[0].mean())), float(np.sqrt(squares[1].mean())), interval
    )
