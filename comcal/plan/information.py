# SPDX-License-Identifier: Apache-2.0
r"""What a pose tells, by the very rows and weights of the identification.

Planned poses are written as the table that they will be measured into, and that table goes through
:mod:`comcal.identify`: its rows A of every pose and the inverse W of their full covariance
:math:`B \Sigma B^T` give the information :math:`A^T W A` on its unknowns.
"""

from __future__ import annotations

import numpy as np

from comcal.identify.adjust import Adjustment, adjust
from comcal.identify.groups import groups_of
from comcal.identify.linearise import linearise
from comcal.identify.unknowns import Unknowns
from comcal.measure.table import PoseTable
from comcal.plan.candidates import Pool
from comcal.plan.expected import expected_table
from comcal.robot.tree import Array

BLOCK = 500
"""Poses worked on together, to bound memory."""


def information_roots(unknowns: Unknowns, poses: Pool) -> Array:
    """Return the rows of every planned pose in units of their noise, for scaled unknowns.

    Parameters
    ----------
    unknowns : Unknowns
    poses : Pool
        Balanced poses.

    Returns
    -------
    roots : array, shape (N, n_rows, size)
        The information of pose n on the unknowns in units of ``unknowns.scale`` is
        ``roots[n].T @ roots[n]``. Poses with fewer rows than others have zeros at the end.
    """
    blocks: list[Array] = []
    for start in range(0, len(poses), BLOCK):
        part = poses.select(range(start, min(start + BLOCK, len(poses))))
        blocks.append(table_roots(unknowns, expected_table(unknowns.robot, part)))
    n_rows = max((block.shape[1] for block in blocks), default=0)
    return np.concatenate(
        [np.zeros((0, n_rows, unknowns.size)), *(_padded(b, n_rows) for b in blocks)]
    )


def table_roots(unknowns: Unknowns, table: PoseTable) -> Array:
    """Return the same for the poses of a table, in its order; poses without rows have zeros.

    Parameters
    ----------
    unknowns : Unknowns
    table : PoseTable

    Raises
    ------
    DataError
        If the wrench or the error of a loaded sensor is not known.
    """
    found: list[tuple[tuple[int, ...], Array]] = []
    for group in groups_of(unknowns.robot, table):
        linear = linearise(unknowns.robot, unknowns, group, unknowns.cad, group.inputs)
        # W = L L^T, so the information A^T W A is that of L^T A.
        L = np.linalg.cholesky(linear.W)
        found.append((group.rows, np.swapaxes(L, 1, 2) @ (linear.A * unknowns.scale)))
    n_rows = max((root.shape[1] for _, root in found), default=0)
    roots = np.zeros((len(table), n_rows, unknowns.size))
    for rows, root in found:
        roots[list(rows)] = _padded(root, n_rows)
    return roots


def _padded(root: Array, n_rows: int) -> Array:
    missing = n_rows - root.shape[1]
    return np.pad(root, ((0, 0), (0, missing), (0, 0)))


def predicted_fit(unknowns: Unknowns, *tables: PoseTable) -> Adjustment:
    """Return the fit that poses will have if the nominal model is true.

    Parameters
    ----------
    unknowns : Unknowns
    *tables : PoseTable
        Planned poses as :func:`~comcal.plan.expected.expected_table` makes them; recorded ones.
    """
    robot = unknowns.robot
    return adjust(robot, unknowns, [g for table in tables for g in groups_of(robot, table)])
