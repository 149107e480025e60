# SPDX-License-Identifier: Apache-2.0
"""Minors of a matrix, each built of smaller ones and named once; Cramer's rule by them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.program import Steps


def minors_by_columns(
    rows: Sequence[Sequence[Expr]],
    columns: Sequence[str],
    steps: Steps,
    prefix: str,
    *,
    real: bool = False,
) -> dict[int, Expr]:
    """Return the minors of all rows by their columns, those that are not zero.

    Minors of the first k rows are expanded along row k into minors of the first k - 1 rows. There
    is no division, so no pivot can vanish.

    Parameters
    ----------
    rows : sequence of sequence of sympy.Expr
        At most as many as columns.
    columns : sequence of str
        Their names.
    steps : Steps
        The steps are added to it.
    prefix : str
        Of the names of the steps.
    real : bool
        Whether all entries are real.

    Returns
    -------
    dict
        By the set of columns: bit v of the key stands for column v.
    """
    return minor_levels(rows, columns, steps, prefix, real=real)[-1]


def minor_levels(
    rows: Sequence[Sequence[Expr]],
    columns: Sequence[str],
    steps: Steps,
    prefix: str,
    *,
    real: bool = False,
) -> list[dict[int, Expr]]:
    """Return the minors of the first 0, 1 .. all rows, as :func:`minors_by_columns` names them.

    Parameters
    ----------
    rows, columns, steps, prefix, real
        As there.
    """
    levels: list[dict[int, Expr]] = [{0: sp.Integer(1)}]
    for k, row in enumerate(rows, start=1):
        larger: dict[int, Expr] = {}
        for chosen in combinations(range(len(columns)), k):
            key = sum(1 << v for v in chosen)
            terms: list[Expr] = []
            for place, v in enumerate(chosen):
                smaller = levels[-1].get(key ^ (1 << v))
                if smaller is not None and row[v] != 0:
                    sign = -1 if (k - 1 - place) % 2 else 1
                    terms.append(sp.Mul(sign, row[v], smaller))
            value = sp.Add(*terms)
            if value != 0:
                name = "_".join([prefix, *(columns[v] for v in chosen)])
                larger[key] = steps.let(name, value, real=real)
        levels.append(larger)
    return levels


def cramer_by_minors(
    rows: Sequence[Sequence[Expr]],
    rhs: Sequence[Expr],
    columns: Sequence[str],
    unknowns: Sequence[str],
    steps: Steps,
    *,
    real: bool = False,
) -> tuple[list[Expr], Expr] | None:
    """Return the solution of a square system by Cramer's rule, and the determinant.

    All determinants of the rule are built of the minors of the rows bordered by the right-hand
    side, each of which is computed once.

    Parameters
    ----------
    rows : sequence of sequence of sympy.Expr
        n rows of n.
    rhs : sequence of sympy.Expr
    columns, unknowns : sequence of str
        Names of the columns in those of the minors, and of the unknowns.
    steps : Steps
        The steps are added to it.
    real : bool
        Whether all entries are real.

    Returns
    -------
    tuple or None
        None where the determinant is zero for all values of the symbols.
    """
    n = len(rows)
    bordered = [[*row, b] for row, b in zip(rows, rhs, strict=True)]
    minors = minors_by_columns(bordered, [*columns, "K"], steps, "M", real=real)
    full = (1 << n) - 1
    det = minors.get(full, sp.Integer(0))
    if det == 0:
        return None
    inverse = steps.let("inverse", 1 / det, real=real)
    found: list[Expr] = []
    for v, name in enumerate(unknowns):
        # The right-hand side stands last in its minor; moving it to column v changes the sign.
        numerator = minors.get(full ^ (1 << v) | 1 << n, sp.Integer(0))
        sign = (-1) ** (n - 1 - v)
        found.append(steps.let(name, sign * numerator * inverse, real=real))
    return found, det
