# SPDX-License-Identifier: Apache-2.0
"""Minors of a matrix, each built of smaller ones and named once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.program import Steps


def minors_by_columns(
    rows: Sequence[Sequence[Expr]], columns: Sequence[str], steps: Steps, prefix: str
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

    Returns
    -------
    dict
        By the set of columns: bit v of the key stands for column v.
    """
    minors: dict[int, Expr] = {0: sp.Integer(1)}
    for k, row in enumerate(rows, start=1):
        larger: dict[int, Expr] = {}
        for chosen in combinations(range(len(columns)), k):
            key = sum(1 << v for v in chosen)
            terms: list[Expr] = []
            for place, v in enumerate(chosen):
                smaller = minors.get(key ^ (1 << v))
                if smaller is not None and row[v] != 0:
                    sign = -1 if (k - 1 - place) % 2 else 1
                    terms.append(sp.Mul(sign, row[v], smaller))
            value = sp.Add(*terms)
            if value != 0:
                name = "_".join([prefix, *(columns[v] for v in chosen)])
                larger[key] = steps.let(name, value)
        minors = larger
    return minors
