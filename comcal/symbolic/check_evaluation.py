# SPDX-License-Identifier: Apache-2.0
"""A formula evaluated once, and then with one part changed at a time, at little cost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.formula_tree import Node, Path, combine, leaf, node_at

AGREES = 1e-9
"""Largest difference, relative to the terms of the formula, that still is agreement [1]."""


class Evaluation:
    """The values of all parts of a formula at some points.

    Parameters
    ----------
    root : Node
    env : mapping of str to array, shape (count,)
        Value of every symbol.
    target : array, shape (count,)
        What the formula should be; zero for an equation.
    """

    def __init__(self, root: Node, env: Mapping[str, Array], target: Array) -> None:
        self.root = root
        self.env = env
        self.target = target
        self._values: dict[Path, Array] = {}
        with np.errstate(all="ignore"):
            self.value = self._fill(root, ())
            self.scale = np.abs(target) + self._terms(root, ())

    def at(self, path: Path) -> Array:
        """Return the value of the part at *path*, shape (count,)."""
        return self._values[path]

    def error(self, value: Array | None = None) -> Array:
        """Return how far the formula is off, relative to its terms, shape (count,) [1].

        Parameters
        ----------
        value : array, shape (count,), or None
            Of the formula with a part changed; None: as it stands.
        """
        value = self.value if value is None else value
        with np.errstate(all="ignore"):
            error = np.abs(value - self.target) / self.scale
        error = np.where(value == self.target, 0.0, error)
        return np.where(np.isnan(error), np.inf, error)

    def agrees(self, value: Array | None = None) -> bool:
        """Return whether the formula is right at every point.

        Parameters
        ----------
        value : array, shape (count,), or None
            As for :meth:`error`.
        """
        return bool(np.all(self.error(value) <= AGREES))

    def replaced(self, path: Path, value: Array) -> Array:
        """Return the formula with the part at *path* having another value, shape (count,).

        Parameters
        ----------
        path : tuple of int
        value : array, shape (count,)
        """
        with np.errstate(all="ignore"):
            for depth in range(len(path) - 1, -1, -1):
                parent, here = path[:depth], path[depth]
                node = node_at(self.root, parent)
                if node.op == "sum":
                    change = value - self._values[(*parent, here)]
                    total = self._values[parent]
                    value = total - change if node.inverse[here] else total + change
                else:
                    children = self._children(node, parent)
                    children[here] = value
                    value = combine(node, children)
        return value

    def wanted(self, path: Path) -> Array | None:
        """Return the value that the part at *path* must have to make the formula right.

        Returns
        -------
        array, shape (count,), or None
            None inside a function or an exponent, where it is not unique.
        """
        value, node = self.target, self.root
        with np.errstate(all="ignore"):
            for depth, here in enumerate(path):
                parent = path[:depth]
                others = self._children(node, parent)
                if node.op == "sum":
                    rest = self._values[parent] - _signed(node, here, others[here])
                    value = _signed(node, here, value - rest)
                elif node.op == "equation":
                    value = value + others[1] if here == 0 else others[0] - value
                elif node.op == "product":
                    # With the factor itself set to one, what is left is the product of the others.
                    others[here] = np.ones_like(value)
                    rest = combine(node, others)
                    value = rest / value if node.inverse[here] else value / rest
                else:
                    return None
                node = node.children[here]
        return value

    def _fill(self, node: Node, path: Path) -> Array:
        if node.children:
            children = [self._fill(child, (*path, i)) for i, child in enumerate(node.children)]
            value = combine(node, children)
        else:
            value = leaf(node, self.env)
        self._values[path] = value
        return value

    def _children(self, node: Node, path: Path) -> list[Array]:
        return [self._values[(*path, i)] for i in range(len(node.children))]

    def _terms(self, node: Node, path: Path) -> Array:
        """Return the sum of the absolute values of the outermost terms."""
        if node.op in {"sum", "equation"}:
            parts = [self._terms(child, (*path, i)) for i, child in enumerate(node.children)]
            return np.sum(parts, axis=0)
        return np.abs(self._values[path])


def _signed(node: Node, i: int, value: Array) -> Array:
    return -value if node.inverse[i] else value
