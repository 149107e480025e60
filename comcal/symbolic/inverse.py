# SPDX-License-Identifier: Apache-2.0
"""The inverse of a matrix as cofactors over determinant, by Laplace's expansion in the middle.

The cofactor of entry (i, v) is a sum of products of a minor of the rows above i and one of the
rows below it. Both kinds are named once and serve all cofactors.
"""

from __future__ import annotations

from collections.abc import Sequence

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.minors import minor_levels
from comcal.symbolic.program import Steps


def inverse_by_minors(
    rows: Sequence[Sequence[Expr]], columns: Sequence[str], steps: Steps
) -> tuple[list[list[Expr]], Expr] | None:
    """Return the inverse of a real matrix, a row per column of it, and the determinant.

    Parameters
    ----------
    rows : sequence of sequence of sympy.Expr
        n rows of n.
    columns : sequence of str
        Their names.
    steps : Steps
        The steps are added to it.

    Returns
    -------
    tuple or None
        None where the determinant is zero for all values of the symbols.
    """
    n = len(rows)
    above = minor_levels(rows, columns, steps, "M", real=True)
    below = minor_levels(rows[::-1], columns, steps, "N", real=True)
    full = (1 << n) - 1
    det = above[n].get(full, sp.Integer(0))
    if det == 0:
        return None
    inverse = steps.let("inverse", 1 / det, real=True)
    found: list[list[Expr]] = []
    for v in range(n):
        others = full ^ (1 << v)
        values: list[Expr] = []
        for i in range(n):
            terms: list[Expr] = []
            for chosen, minor in above[i].items():
                rest = below[n - 1 - i].get(others ^ chosen) if chosen & others == chosen else None
                if rest is not None:
                    terms.append(_sign(chosen, others, n, i) * minor * rest)
            value = (-1) ** (i + v) * sp.Add(*terms) * inverse
            values.append(steps.let(f"I_{columns[v]}_{i + 1}", value, real=True))
        found.append(values)
    return found, det


def _sign(chosen: int, others: int, n: int, i: int) -> int:
    """Return the sign of Laplace's term in which the first i rows take the columns *chosen*."""
    positions = [v for v in range(n) if others >> v & 1]
    crossed = sum(
        k - t for t, k in enumerate(k for k, v in enumerate(positions) if chosen >> v & 1)
    )
    # The rows below stand in reverse order in their minors.
    size = n - 1 - i
    return (-1) ** (crossed + size * (size - 1) // 2)
