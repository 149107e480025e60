# SPDX-License-Identifier: Apache-2.0
"""The order in which to take poses: one support after the other, short moves within each."""

from __future__ import annotations

import numpy as np

from comcal.measure.plan import DOUBLE
from comcal.plan.candidates import Pool
from comcal.robot.tree import Array


def ordered(poses: Pool, rest: Array, scale: Array) -> Pool:
    """Return the poses in an order with short moves.

    Both feet first, then foot after foot, so that the feet move least. Within a support: always to
    the nearest pose that is left, then pieces of the way are turned round while that shortens it.

    Parameters
    ----------
    poses : Pool
    rest : array, shape (n_joints,)
        Where the robot starts.
    scale : array, shape (n_joints,)
        Size of a long move of each joint; the joint that moves furthest counts.
    """
    way: list[int] = []
    here = rest
    for support in sorted(set(poses.support), key=lambda s: (s != DOUBLE, s)):
        rows = [i for i, s in enumerate(poses.support) if s == support]
        q = np.vstack([here, poses.q[rows]]) / np.where(scale > 0.0, scale, 1.0)
        distance = np.max(np.abs(q[:, None] - q[None]), axis=2)
        steps = _turned(distance, _nearest(distance))
        way += [rows[i - 1] for i in steps[1:]]
        here = poses.q[way[-1]]
    return poses.select(way)


def longest_move(poses: Pool) -> float:
    """Return the furthest that any joint goes between consecutive poses [rad] or [m]."""
    return float(np.max(np.abs(np.diff(poses.q, axis=0)), initial=0.0))


def _nearest(distance: Array) -> list[int]:
    way, left = [0], set(range(1, len(distance)))
    while left:
        way.append(min(left, key=lambda i: (float(distance[way[-1], i]), i)))
        left.remove(way[-1])
    return way


def _turned(distance: Array, way: list[int]) -> list[int]:
    """Turn pieces of an open way round (2-opt); its first place stays."""
    improved = True
    while improved:
        improved = False
        for i in range(1, len(way) - 1):
            for j in range(i + 1, len(way)):
                a, b, c = way[i - 1], way[i], way[j]
                after = way[j + 1] if j + 1 < len(way) else None
                old = distance[a, b] + (distance[c, after] if after is not None else 0.0)
                new = distance[a, c] + (distance[b, after] if after is not None else 0.0)
                if new < old - 1e-9:
                    way[i : j + 1] = way[i : j + 1][::-1]
                    improved = True
    return way
