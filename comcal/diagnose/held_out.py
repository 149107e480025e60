# SPDX-License-Identifier: Apache-2.0
"""Errors of held-out poses in units that people use: force, moment, CoM, torque."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from comcal.diagnose.diagnosis import HeldOut
from comcal.diagnose.scene import Scene
from comcal.robot.tree import Array

CONFIDENCE = 0.95


def quantities(scene: Scene, before: Array, after: Array) -> tuple[HeldOut, ...]:
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


def _interval(values: Array) -> tuple[float, float]:
    n = len(values)
    mean = float(values.mean())
    half = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2) * values.std(ddof=1) / np.sqrt(n))
    return mean - half, mean + half
