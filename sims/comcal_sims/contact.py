# SPDX-License-Identifier: Apache-2.0
"""How the weight of a standing robot is shared among the corners of its soles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import skew
from comcal.robot.tree import Array

_PULL = -1e-9
"""Normal force, relative to the load, below which a corner would have to pull."""
_SUPPORTING = 3
"""Corners without which nothing stands."""


def corner_forces(points: Array, normal: Array, force: Array, moment: Array) -> Array:
    """Return the smallest corner forces that carry a load.

    Two flat feet are statically indeterminate. The rule taken here is that of equal isotropic
    springs under all corners of a rigid robot: the forces of least sum of squares. Corners that
    would have to pull lift off, the worst first. Whatever the rule, the total is exact.

    Parameters
    ----------
    points : array, shape (n, 3)
        Corners, in the world [m].
    normal : array, shape (3,)
        Unit normal of the floor, up.
    force, moment : array, shape (3,)
        What the floor has to exert, the moment about the world's origin [N, N m].

    Returns
    -------
    forces : array, shape (n, 3)
        Of the floor on each corner, in the world [N].
    """
    wanted = np.concatenate([force, moment])
    active = np.arange(len(points))
    forces = _least_norm(points, active, wanted)
    while True:
        normal_forces = forces[active] @ normal
        worst = int(np.argmin(normal_forces))
        if normal_forces[worst] >= _PULL * np.linalg.norm(force) or active.size == _SUPPORTING:
            return forces
        fewer = np.delete(active, worst)
        released = _least_norm(points, fewer, wanted)
        if not np.allclose(
            _total(points, released), wanted, rtol=0.0, atol=1e-9 * abs(wanted).max()
        ):
            return forces
        active, forces = fewer, released


def _least_norm(points: Array, active: npt.NDArray[np.intp], wanted: Array) -> Array:
    forces = np.zeros_like(points)
    grasp = np.vstack(
        [np.tile(np.eye(3), active.size), np.hstack(list(skew(points[active])))],
    )
    forces[active] = np.linalg.lstsq(grasp, wanted, rcond=None)[0].reshape(-1, 3)
    return forces


def _total(points: Array, forces: Array) -> Array:
    return np.concatenate([forces.sum(axis=0), np.cross(points, forces).sum(axis=0)])
