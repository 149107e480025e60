# SPDX-License-Identifier: Apache-2.0
"""Residuals row by row: how large, against what they go along with, and pose by pose for plots."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from comcal.diagnose.diagnosis import Channel, Trace
from comcal.diagnose.follows import ENOUGH, companion
from comcal.diagnose.naming import Named
from comcal.diagnose.scene import Scene
from comcal.measure.table import PoseTable
from comcal.predict.parity import Row
from comcal.robot.tree import Array

FOLLOWS = 0.8
"""Correlation from which a residual is said to follow something."""
STANDS_OUT = 1.5
"""Sigmas from which it is worth looking for what a residual follows."""


@dataclass(frozen=True)
class RowFit:
    """One row over its poses.

    Parameters
    ----------
    row : Row
    index : array of int, shape (k,)
        Residuals of this row.
    before, after : array, shape (k,)
    sigma : array, shape (k,)
        Noise and healthy spread together, of the model as given.
    chi2_before, chi2_after : float
        Against the covariance of the row over its poses, of the model as given and about the
        causes: k if nothing is wrong.
    rows_after : int
        Residuals that still have a value once the causes are taken into account.
    """

    row: Row
    index: npt.NDArray[np.intp]
    before: Array
    after: Array
    sigma: Array
    chi2_before: float
    chi2_after: float
    rows_after: int


def residuals_before(scene: Scene, named: Named) -> tuple[Array, Array]:
    """Return residuals of the model as given and as extended, shape (n,); NaN where missing."""
    before = np.where(_used(scene), scene.at.at.values, np.nan)
    after = np.full(named.scene.by.n, np.nan)
    left = named.scene.r - named.scene.X @ coordinates_of(named)
    by = named.scene.by
    for rows, root, mine in zip(by.rows, by.roots, by.slices, strict=True):
        after[rows] = root @ left[mine]
    return before, after


def coordinates_of(named: Named) -> Array:
    """Return the coordinates of all candidates, zero but for the causes, shape (p,)."""
    x = np.zeros(len(named.scene.of.fault))
    first = 0
    for i in named.causes:
        part = named.scene.of.slices[i]
        x[part] = named.fit.coordinates[first : first + part.stop - part.start]
        first += part.stop - part.start
    return x


def row_fits(scene: Scene, named: Named) -> tuple[RowFit, ...]:
    """Judge every row over all poses that have it, supports together."""
    before, after = residuals_before(scene, named)
    rows = scene.at.at.row
    of_row: dict[Row, list[int]] = {}
    for n in np.flatnonzero(np.isfinite(before)):
        of_row.setdefault(rows[n], []).append(int(n))
    given = _Healthy(replace(scene, scales=named.scene.scales))
    about_causes = _Healthy(named.scene)
    found: list[RowFit] = []
    for row, numbers in of_row.items():
        index = np.array(numbers, np.intp)
        C = given.covariance(index)
        kept = index[np.isfinite(after[index])]
        left = after[kept]
        found.append(
            RowFit(
                row,
                index,
                before[index],
                after[index],
                np.sqrt(np.diag(C)),
                float(before[index] @ np.linalg.solve(C, before[index])),
                float(left @ np.linalg.solve(about_causes.covariance(kept), left)),
                len(kept),
            )
        )
    return tuple(found)


class _Healthy:
    """Covariances of residuals of a healthy robot, about the state of a scene."""

    def __init__(self, scene: Scene) -> None:
        spread = scene.of.spread(scene.scales)
        at = np.flatnonzero(spread)
        self._T = scene.raw[:, at] * spread[at]
        self._noise = _noise_variance(scene)

    def covariance(self, index: npt.NDArray[np.intp]) -> Array:
        """Return that of some residuals, shape (k, k)."""
        T = self._T[index]
        return T @ T.T + np.diag(self._noise[index])


def channels_of(scene: Scene, fits: tuple[RowFit, ...]) -> tuple[Channel, ...]:
    """Return all rows, the one that is furthest off first."""
    table = scene.at.table
    found: list[Channel] = []
    for fit in fits:
        k = len(fit.index)
        pose = scene.at.at.pose[fit.index]
        sigmas = float(np.sqrt(fit.chi2_before / k))
        worst = int(np.argmax(np.abs(fit.before / fit.sigma)))
        found.append(
            Channel(
                fit.row.name,
                fit.row.unit,
                _rms(fit.before),
                _rms(fit.after),
                sigmas,
                float(np.sqrt(fit.chi2_after / max(fit.rows_after, 1))),
                what_it_follows(table.select(pose), fit, scene) if sigmas > STANDS_OUT else "",
                table.pose[int(pose[worst])],
            )
        )
    return tuple(sorted(found, key=lambda channel: -channel.sigmas_before))


def traces_of(scene: Scene, fits: tuple[RowFit, ...]) -> tuple[Trace, ...]:
    """Return every row pose by pose."""
    poses = scene.at.table.pose
    return tuple(
        Trace(
            fit.row.name,
            fit.row.unit,
            tuple(poses[int(p)] for p in scene.at.at.pose[fit.index]),
            fit.before,
            fit.after,
            fit.sigma,
        )
        for fit in fits
    )


def chance(fits: tuple[RowFit, ...]) -> tuple[float, str]:
    """Return how likely it is by chance that a row is so far off after the causes, and which."""
    rows = [(float(chdtrc(max(fit.rows_after, 1), fit.chi2_after)), fit.row.name) for fit in fits]
    worst, name = min(rows, default=(1.0, ""))
    return min(1.0, worst * len(rows)), name


def what_it_follows(table: PoseTable, fit: RowFit, scene: Scene) -> str:
    """Return in words what a residual goes along with; empty where nothing stands out.

    Parameters
    ----------
    table : PoseTable
        The poses of the row, in its order.
    fit : RowFit
    scene : Scene
    """
    values = fit.before
    if len(values) < ENOUGH:
        return ""
    if abs(values.mean()) > 2.0 * values.std():
        return "constant"
    return companion(values, _companions(table, scene).items(), FOLLOWS)


def _companions(table: PoseTable, scene: Scene) -> dict[str, Array]:
    joints = scene.at.assumed.robot.tree.joint_names
    found = {"the time": table.t}
    found |= {f"the temperature {name}".strip(): v for name, v in table.temperature.items()}
    found |= {f"the load of {name}": w[:, 2] for name, w in table.wrench.items()}
    found |= {f"the angle of {name}": table.q[:, k] for k, name in enumerate(joints)}
    found |= {f"the approach of {name}": table.approach[:, k] for k, name in enumerate(joints)}
    found |= {f"the current of {name}": table.current[:, k] for k, name in enumerate(joints)}
    return found


def _noise_variance(scene: Scene) -> Array:
    found = np.zeros(scene.by.n)
    for rows, root in zip(scene.by.rows, scene.by.roots, strict=True):
        found[rows] = np.sum(root**2, axis=1)
    return found


def _used(scene: Scene) -> npt.NDArray[np.bool_]:
    mask = np.zeros(scene.by.n, np.bool_)
    mask[scene.by.used] = True
    return mask


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else 0.0
