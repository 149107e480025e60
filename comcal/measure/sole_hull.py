# SPDX-License-Identifier: Apache-2.0
"""The convex hull of a few points in the plane, and how far outside a point lies."""

from __future__ import annotations

import numpy as np

from comcal.robot.tree import Array


def convex_hull(points: Array) -> Array:
    """Return the corners of the convex hull, counter-clockwise, shape (m, 2).

    Parameters
    ----------
    points : array, shape (n, 2)

    Notes
    -----
    Andrew's monotone chain: the lower, then the upper boundary, from left to right and back.
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)
    corners: list[tuple[float, float]] = []
    for half in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for point in half:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        corners += chain[:-1]
    return np.array(corners)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Return twice the area of a triangle, positive when it turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def distance_outside(point: Array, points: Array) -> float:
    """Return how far *point* lies outside the convex hull of *points*; 0 inside.

    Parameters
    ----------
    point : array, shape (2,)
    points : array, shape (n, 2)
        Same unit as the result.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> [distance_outside(np.array([x, 0.5]), square) for x in (0.9, 1.5)]
    [0.0, 0.5]
    """
    return max(-distance_inside(point, points), 0.0)


def distance_inside(point: Array, points: Array) -> float:
    """Return how far *point* is from the edge of the convex hull of *points*; negative outside.

    Parameters
    ----------
    point : array, shape (2,)
    points : array, shape (n, 2)
        Same unit as the result.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> [distance_inside(np.array([x, 0.5]), square) for x in (0.75, 1.5)]
    [0.25, -0.5]
    """
    corners = convex_hull(points)
    edges = np.roll(corners, -1, axis=0) - corners
    to_point = np.asarray(point) - corners
    cross = edges[:, 0] * to_point[:, 1] - edges[:, 1] * to_point[:, 0]
    is_inside = len(corners) > 2 and bool((cross >= 0.0).all())
    length = np.einsum("ij,ij->i", edges, edges)
    along = np.einsum("ij,ij->i", to_point, edges) / np.where(length > 0.0, length, 1.0)
    nearest = corners + np.clip(along, 0.0, 1.0)[:, None] * edges
    distance = float(np.linalg.norm(point - nearest, axis=1).min())
    return distance if is_inside else -distance
