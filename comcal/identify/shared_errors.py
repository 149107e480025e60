# SPDX-License-Identifier: Apache-2.0
r"""Errors that all poses of a session share: tares of force sensors, torque constants, friction.

With S the block-diagonal covariance of the rows from what every pose has for itself, and C their
reaction to the shared errors in units of their standard deviations, the rows have the covariance
:math:`S + C C^T`, whose inverse is, by Woodbury,

.. math:: S^{-1} - S^{-1} C D^{-1} C^T S^{-1}, \qquad D = 1 + C^T S^{-1} C .
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.identify.groups import Group
from comcal.identify.linearise import Linearised
from comcal.robot.tree import Array


@dataclass(frozen=True)
class RowErrors:
    """Everything that disturbs the rows of a session.

    Parameters
    ----------
    groups : tuple of Group
    linear : tuple of Linearised, one per group
    roots : tuple of array, one per group, each shape (N or 1, n_inputs, n_shared)
        Change of the inputs of each (or any) pose by one standard deviation of each shared error.
    """

    groups: tuple[Group, ...]
    linear: tuple[Linearised, ...]
    roots: tuple[Array, ...]

    @property
    def C(self) -> tuple[Array, ...]:
        """What one standard deviation of each shared error does, (N, n_rows, n_shared)."""
        return tuple(a.B @ root for a, root in zip(self.linear, self.roots, strict=True))

    def weighted(self, rows: Sequence[Array]) -> tuple[Array, ...]:
        """Multiply columns of all rows by the inverse of their whole covariance.

        Parameters
        ----------
        rows : sequence of array, one per group, each shape (N, n_rows, n_columns)
        """
        C = self.C
        alone = [a.W @ r for a, r in zip(self.linear, rows, strict=True)]
        if not C[0].shape[2]:
            return tuple(alone)
        W_C = [a.W @ c for a, c in zip(self.linear, C, strict=True)]
        D = np.eye(C[0].shape[2]) + over_poses(C, W_C)
        shared = np.linalg.solve(D, over_poses(C, alone))
        return tuple(x - w @ shared for x, w in zip(alone, W_C, strict=True))

    def adjusted_inputs(self, measured: Sequence[Array], weighted: Sequence[Array]) -> list[Array]:
        """Return the inputs freed of the errors that explain the residuals best.

        Parameters
        ----------
        measured : sequence of array, one per group, each shape (N, n_inputs)
            What was measured, less the tares that are unknowns.
        weighted : sequence of array, one per group, each shape (N, n_rows)
            Residuals times the inverse covariance.
        """
        shared = over_poses(self.C, [x[:, :, None] for x in weighted])[:, 0]
        return [
            inputs - np.einsum("nij,nkj,nk->ni", group.cov, a.B, x, optimize=True) - root @ shared
            for inputs, group, a, x, root in zip(
                measured, self.groups, self.linear, weighted, self.roots, strict=True
            )
        ]


def row_errors(groups: Sequence[Group], linear: Sequence[Linearised]) -> RowErrors:
    """Collect the errors of linearised groups."""
    return RowErrors(tuple(groups), tuple(linear), shared_roots(groups))


def shared_roots(groups: Sequence[Group]) -> tuple[Array, ...]:
    """Return what one standard deviation of each shared error does to the inputs of each group.

    Parameters
    ----------
    groups : sequence of Group

    Returns
    -------
    tuple of array, one per group, each shape (N or 1, n_inputs, n_shared)
        Errors of one name are the same in all groups: a sensor that is loaded in several kinds of
        support has one tare.
    """
    width = {name: root.shape[2] for group in groups for name, root in group.shared.items()}
    roots: list[Array] = []
    for group in groups:
        n = max((len(root) for root in group.shared.values()), default=1)
        parts = [np.zeros((n, group.layout.n_inputs, 0))]
        for name, columns in width.items():
            root = group.shared.get(name, np.zeros((1, group.layout.n_inputs, columns)))
            parts.append(np.broadcast_to(root, (n, *root.shape[1:])))
        roots.append(np.concatenate(parts, axis=2))
    return tuple(roots)


def over_poses(left: Sequence[Array], right: Sequence[Array]) -> Array:
    """Return the sum over all poses of left^T right, shape (n_left, n_right).

    Parameters
    ----------
    left, right : sequence of array, one per group
        Each (N, n_rows, n_left) and (N, n_rows, n_right).
    """

    def rows(a: Array) -> Array:
        return a.reshape(a.shape[0] * a.shape[1], a.shape[2])

    products = [rows(a).T @ rows(b) for a, b in zip(left, right, strict=True)]
    return np.asarray(np.sum(products, axis=0), np.float64)
