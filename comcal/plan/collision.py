# SPDX-License-Identifier: Apache-2.0
"""Whether links of a robot touch one another, by the collision library coal where it is there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from comcal.plan.solids import Solid, Solids
from comcal.robot.kinematics import Placements
from comcal.robot.soles import place_at_zero
from comcal.robot.tree import Array, Shape, Tree

DISTANCE = 0.005
"""Solids nearer to one another than this count as touching [m]."""


@dataclass(frozen=True)
class Collisions:
    """Pairs of solids that must not touch.

    Parameters
    ----------
    solids : tuple of Solid
    pairs : array of int, shape (n_pairs, 2)
        Of different bodies that are not neighbours and do not touch at q = 0 anyway.
    centres, radii : array, shape (n_solids, 3) and (n_solids,)
        Balls around the solids, in the link frames [m]: what they keep apart is not looked at.
    shapes : tuple
        The same solids as coal sees them.
    """

    solids: tuple[Solid, ...]
    pairs: npt.NDArray[np.intp]
    centres: Array
    radii: Array
    shapes: tuple[Any, ...]

    def without(self, links: npt.NDArray[np.bool_]) -> Collisions:
        """Return the same without the pairs in which one of the marked links takes part."""
        marked = np.array([links[solid.link] for solid in self.solids], np.bool_)
        keep = ~marked[self.pairs].any(axis=1) if len(self.pairs) else slice(0)
        return replace(self, pairs=self.pairs[keep])

    def free(self, at: Placements) -> npt.NDArray[np.bool_]:
        """Return which of N poses are free of contact, shape (N,)."""
        if not len(self.pairs):
            return np.ones(len(at.p), np.bool_)
        links = [solid.link for solid in self.solids]
        R, p = at.R[:, links], at.p[:, links]
        centre = p + (R @ self.centres[:, :, None])[..., 0]
        i, j = self.pairs.T
        apart = np.linalg.norm(centre[:, i] - centre[:, j], axis=-1)
        near = apart < self.radii[i] + self.radii[j] + DISTANCE
        coal = import_module("coal")
        free = [not self._touching(coal, R[n], p[n], near[n]) for n in range(len(R))]
        return np.array(free, np.bool_)

    def _touching(self, coal: Any, R: Array, p: Array, near: npt.NDArray[np.bool_]) -> bool:
        request = coal.CollisionRequest()
        request.security_margin = DISTANCE
        placed: dict[int, Any] = {}
        for i, j in self.pairs[near]:
            for k in (int(i), int(j)):
                if k not in placed:
                    _, T = self.shapes[k]
                    placed[k] = coal.Transform3s(R[k] @ T[:3, :3], R[k] @ T[:3, 3] + p[k])
            result = coal.CollisionResult()
            a, b = int(i), int(j)
            coal.collide(
                self.shapes[a][0], placed[a], self.shapes[b][0], placed[b], request, result
            )
            if result.isCollision():
                return True
        return False


def is_available() -> bool:
    """Return whether the collision library is installed."""
    return find_spec("coal") is not None


def collisions_of(tree: Tree, solids: Solids) -> Collisions:
    """Return the pairs to be watched; none without the library.

    Parameters
    ----------
    tree : Tree
    solids : Solids
    """
    known = solids.solids if is_available() else ()
    body, parent = tree.bodies.of_link, tree.bodies.parents
    pairs = [
        (i, j)
        for j in range(len(known))
        for i in range(j)
        if (a := body[known[i].link]) != (b := body[known[j].link])
        and parent[a] != b
        and parent[b] != a
    ]
    centres = np.array([0.5 * (s.points.max(0) + s.points.min(0)) for s in known]).reshape(-1, 3)
    radii = np.array(
        [np.linalg.norm(s.points - c, axis=1).max() for s, c in zip(known, centres, strict=True)]
    )
    shapes = tuple(_shape(solid) for solid in known)
    every = Collisions(known, np.array(pairs, np.intp).reshape(-1, 2), centres, radii, shapes)
    zero = place_at_zero(tree)
    lasting = [
        pair
        for pair in every.pairs
        if Collisions(known, pair[None], centres, radii, shapes).free(zero)[0]
    ]
    return Collisions(known, np.array(lasting, np.intp).reshape(-1, 2), centres, radii, shapes)


def _shape(solid: Solid) -> tuple[Any, Array]:
    """Return coal's geometry of a solid and its pose in the link frame."""
    coal = import_module("coal")
    box = solid.box
    if box is None:
        points = coal.StdVec_Vec3s()
        for point in solid.points:
            points.append(point)
        return coal.Convex.convexHull(points, False, "Qt"), np.eye(4)
    if box.shape is Shape.SPHERE:
        shape = coal.Sphere(0.5 * float(box.size[0]))
    elif box.shape is Shape.CYLINDER:
        shape = coal.Cylinder(0.5 * float(box.size[0]), float(box.size[2]))
    else:
        shape = coal.Box(*(float(x) for x in box.size))
    return shape, box.T_link_box
