# SPDX-License-Identifier: Apache-2.0
"""What the causes are worth: poses predicted that took no part in finding their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtri

from comcal.diagnose.diagnosis import Gain, HeldOut
from comcal.diagnose.evidence import explained
from comcal.diagnose.held_out import quantities
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


@dataclass(frozen=True)
class _Loss:
    """Held-out errors with some of the causes.

    Parameters
    ----------
    squares : float
        Of all poses that were held out, against noise and healthy spread.
    left : array, shape (n,)
        Residuals.
    slope : array, shape (m,)
        Of the squares, with the whitened readings: of poses held out and, by way of the
        parameters, of those that took part.
    """

    squares: float
    left: Array
    slope: Array


def gains(named: Named) -> Gains | None:
    """Cross-validate the causes over poses; None where there are too few poses.

    Parameters are fitted without the fold, linearised about all poses; choosing the causes is not
    repeated.
    """
    scene, causes = named.scene, named.causes
    poses = np.unique(scene.by.pose)
    if len(poses) < LEAST_POSES or not causes:
        return None
    of = _Folds(scene, causes, _dealt(scene, poses), poses)
    with_all, none = of.loss(causes), of.loss(())
    without = [of.loss(tuple(c for c in causes if c != i)) for i in causes]
    rows = sum(len(r) for r in scene.by.rows)
    return Gains(
        tuple(_gain(loss, with_all) for loss in without),
        none.squares / rows,
        with_all.squares / rows,
        quantities(scene, none.left, with_all.left),
    )


def _dealt(scene: Scene, poses: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Deal the poses of every support out to the folds in turn."""
    order = np.argsort([scene.at.table.support[pose] for pose in poses], kind="stable")
    found = np.zeros(len(poses), np.intp)
    found[order] = np.arange(len(poses)) % FOLDS
    return found


@dataclass(frozen=True)
class _Fit:
    """What fits causes without one fold.

    Parameters
    ----------
    held, train : array of bool, shape (m,)
    rows : array of bool, shape (n,)
        The residuals that are held out.
    weighted : array, shape (m_train, k)
        C^-1 X of the columns X of all causes, whitened by noise.
    K, b : array, shape (k, k), (k,)
        X^T C^-1 X and X^T C^-1 r.
    """

    held: npt.NDArray[np.bool_]
    train: npt.NDArray[np.bool_]
    rows: npt.NDArray[np.bool_]
    weighted: Array
    K: Array
    b: Array


@dataclass
class _Folds:
    """Fits of any of the causes without each fold."""

    scene: Scene
    causes: tuple[int, ...]
    dealt: npt.NDArray[np.intp]
    poses: npt.NDArray[np.intp]
    fits: list[_Fit] = field(default_factory=list[_Fit])
    at: npt.NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))

    def __post_init__(self) -> None:
        scene = self.scene
        self.at = _coordinates(scene, self.causes)
        spread = scene.of.spread(scene.scales)
        spread[self.at] = 0.0  # what is healthy of the causes is a part of what is fitted
        healthy = np.flatnonzero(spread)
        for fold in range(FOLDS):
            away = self.poses[self.dealt == fold]
            held = np.isin(scene.by.pose, away)
            T = scene.X[~held][:, healthy] * spread[healthy]
            C = T @ T.T
            C[np.diag_indices_from(C)] += 1.0
            X = scene.X[~held][:, self.at]
            weighted = cho_solve(cho_factor(C, lower=True), X)
            rows = np.isin(scene.at.at.pose, away)
            b = weighted.T @ scene.r[~held]
            self.fits.append(_Fit(held, ~held, rows, weighted, X.T @ weighted, b))

    def loss(self, some: tuple[int, ...]) -> _Loss:
        """Return the errors of poses held out, with some of the causes in the model.

        Of the others no more is there than what is healthy, and the model has nothing of it.
        """
        scene, by, of = self.scene, self.scene.by, self.scene.of
        at = _coordinates(scene, some)
        mine = np.isin(self.at, at)
        size = of.spread(scene.scales, some)[self.at]
        left = _nominal(scene)
        fitted: list[Array] = []
        for fit in self.fits:
            found = explained(
                fit.K, fit.b, size, of.positive[self.at] & mine, of.required[self.at] & mine
            )
            left[fit.rows] -= scene.raw[fit.rows][:, at] @ found.coordinates[mine]
            fitted.append(found.cov[:, mine])
        white = by.turned(left)
        weighted = _weighted(scene, white)
        slope = 2.0 * weighted
        for fit, cov in zip(self.fits, fitted, strict=True):
            by_parameters = 2.0 * scene.X[fit.held][:, at].T @ weighted[fit.held]
            slope[fit.train] -= fit.weighted @ (cov @ by_parameters)
        return _Loss(float(white @ weighted), left, slope)


def _coordinates(scene: Scene, causes: Sequence[int]) -> npt.NDArray[np.intp]:
    parts = [np.arange(scene.of.slices[i].start, scene.of.slices[i].stop) for i in causes]
    return np.concatenate(parts) if parts else np.zeros(0, np.intp)


def _nominal(scene: Scene) -> Array:
    """Return the residuals of the model as given that belong to the linearised causes, (n,)."""
    left = np.zeros(scene.by.n)
    for rows, root, mine in zip(scene.by.rows, scene.by.roots, scene.by.slices, strict=True):
        left[rows] = root @ scene.r[mine]
    return left


def _weighted(scene: Scene, white: Array) -> Array:
    """Return C^-1 r with the covariance C of every pose by itself, whitened by noise, (m,)."""
    spread = scene.of.spread(scene.scales)
    healthy = np.flatnonzero(spread)
    found = np.zeros_like(white)
    for mine in scene.by.slices:
        T = scene.X[mine][:, healthy] * spread[healthy]
        C = T @ T.T
        C[np.diag_indices_from(C)] += 1.0
        found[mine] = np.linalg.solve(C, white[mine])
    return found


def _gain(before: _Loss, after: _Loss) -> Gain:
    """Return the share removed, and its interval.

    Were the same robot to stand in these poses again, its healthy errors would be the same and
    only the noise of its readings another: the gain moves by its slope times the noise, to first
    order. Its scatter over poses would only say that some show the cause and others do not.
    """
    scale = before.squares or 1.0
    gained = before.squares - after.squares
    half = Z * float(np.linalg.norm(before.slope - after.slope))
    # Noise may let it look like more, but nobody gains more than all there is.
    return Gain(gained / scale, ((gained - half) / scale, min((gained + half) / scale, 1.0)))
