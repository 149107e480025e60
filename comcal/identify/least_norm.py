# SPDX-License-Identifier: Apache-2.0
r"""The point nearest to the origin that obeys linear inequalities, or which of them contradict.

.. math:: \min \tfrac12 |e|^2 \quad \text{subject to} \quad N e \le b .

A projection onto a polyhedron: convex, with one answer, and :math:`e = -N^T z` with multipliers
:math:`z \ge 0` that are positive for active rows only. Where there is no such point, there are
:math:`z \ge 0` with :math:`N^T z = 0` and :math:`b^T z < 0`: the rows with positive z, added with
these weights, say that 0 is less than a negative number.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from comcal.errors import DataError, MissingExtraError
from comcal.robot.tree import Array

TOLERANCE = 1e-10
"""Of gap and feasibility, for rows of unit norm."""
IN_CERTIFICATE = 1e-6
"""Rows with less than this share of a certificate's largest weight have no part in it."""


@dataclass(frozen=True)
class LeastNorm:
    """The solution, or why there is none.

    Parameters
    ----------
    point : array, shape (n,), or None
        None where the rows contradict one another.
    multipliers : array, shape (m,)
        z; zero for rows that are not active.
    contradiction : tuple of int
        Rows that cannot hold together, none of which can be left out.
    """

    point: Array | None
    multipliers: Array
    contradiction: tuple[int, ...] = ()


def least_norm(N: Array, b: Array) -> LeastNorm:
    """Return the point nearest to the origin with ``N e <= b``.

    Parameters
    ----------
    N : array, shape (m, n)
        Rows of unit norm; rows of zeros are checked against their *b* alone.
    b : array, shape (m,)

    Raises
    ------
    MissingExtraError
        If the solver is not installed.
    DataError
        If it finds neither a point nor a contradiction.
    """
    solver = _solver()
    hopeless = np.flatnonzero(~N.any(axis=1) & (b < -TOLERANCE))
    if hopeless.size:
        return LeastNorm(None, np.zeros(len(b)), tuple(int(i) for i in hopeless))
    rows = np.flatnonzero(N.any(axis=1))
    multipliers = np.zeros(len(b))
    point, z = _solve(solver, N[rows], b[rows])
    if point is not None:
        multipliers[rows] = z
        return LeastNorm(point, multipliers)
    left = [int(i) for i in rows[z > IN_CERTIFICATE * z.max()]]
    # Several contradictions may share one certificate: what is not needed for one goes.
    for row in list(left):
        fewer = [i for i in left if i != row]
        if fewer and _solve(solver, N[fewer], b[fewer])[0] is None:
            left = fewer
    return LeastNorm(None, multipliers, tuple(left))


def _solver() -> Any:  # the solver has no stubs
    try:
        return importlib.import_module("clarabel")
    except ImportError as error:
        raise MissingExtraError(
            "physical consistency needs clarabel, which is not installed",
            measured=str(error),
            next_step="pip install 'comcal[identify]', or leave out --consistent",
        ) from error


def _solve(solver: Any, N: Array, b: Array) -> tuple[Array | None, Array]:
    """Return the point and the multipliers, or None and a certificate that there is none."""
    n = N.shape[1]
    if not len(b):
        return np.zeros(n), np.zeros(0)
    settings = solver.DefaultSettings()
    settings.verbose = False
    for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas", "tol_infeas_abs", "tol_infeas_rel"):
        setattr(settings, name, TOLERANCE)
    cones = [solver.NonnegativeConeT(len(b))]
    problem = (sparse.identity(n, format="csc"), np.zeros(n), sparse.csc_matrix(N), b, cones)
    found = solver.DefaultSolver(*problem, settings).solve()
    status, z = found.status, np.asarray(found.z, np.float64)
    of = solver.SolverStatus
    if status in (of.Solved, of.AlmostSolved):
        return np.asarray(found.x, np.float64), z
    if status in (of.PrimalInfeasible, of.AlmostPrimalInfeasible):
        return None, z
    raise DataError(
        "the solver found neither masses and CoMs within their bounds nor a contradiction",
        measured=f"status {status}",
        next_step="leave out --consistent, and check the collision geometry in the URDF",
    )
