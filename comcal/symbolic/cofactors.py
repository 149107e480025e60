# SPDX-License-Identifier: Apache-2.0
r"""How the unknowns of Cramer's rule depend on its right-hand side: cofactors over determinant."""

from __future__ import annotations

from comcal.errors import RankError
from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.cramer import phase, reduced_rows
from comcal.symbolic.minors import minors_by_columns
from comcal.symbolic.program import Steps
from comcal.symbolic.system import System


def free_factors(system: System, steps: Steps) -> list[list[Expr]]:
    """Return dG_v/dK_i of n configurations, a row per segment.

    Parameters
    ----------
    system : System
        As many configurations as segments.
    steps : Steps
        The steps are added to it.

    Raises
    ------
    RankError
        If the configurations are one shape for all values of their angles.
    """
    n = len(system.letters)
    first, D = reduced_rows(system, range(n), steps)
    columns = system.letters[1:]
    full = (1 << (n - 1)) - 1
    cofactors: list[list[Expr]] = []
    for i in range(n - 1):
        others = [*D[:i], *D[i + 1 :]]
        found = minors_by_columns(others, columns, steps, f"C_{system.names[i + 1]}")
        cofactors.append(
            [(-1) ** (i + v) * found.get(full ^ (1 << v), sp.Integer(0)) for v in range(n - 1)]
        )
    det = sp.Integer(1)
    if n > 1:
        det = steps.let("det", sp.Add(*(d * c for d, c in zip(D[0], cofactors[0], strict=True))))
    if det == 0:
        raise RankError(
            "the configurations are one shape for all values of their angles",
            next_step="bend one joint at a time; a tilt about the ankles is the same shape",
        )
    inverse = steps.let("inverse", 1 / det)
    turn = [steps.let(f"e_{system.names[i]}", phase(-system.angles[i][0])) for i in range(n)]
    later: list[list[Expr]] = []
    for v in range(n - 1):
        name = columns[v]
        plain = [
            steps.let(f"I_{name}_{system.names[i + 1]}", cofactors[i][v] * inverse)
            for i in range(n - 1)
        ]
        # k_1 enters every row of the reduced system with a minus sign.
        row = [-sp.Add(*plain), *plain]
        later.append(
            [
                steps.let(f"C_{name}_of_{system.names[i]}", factor * turn[i])
                for i, factor in enumerate(row)
            ]
        )
    head: list[Expr] = []
    for i in range(n):
        own = turn[0] if i == 0 else sp.Integer(0)
        rest = sp.Add(*(f * row[i] for f, row in zip(first[1:], later, strict=True)))
        head.append(steps.let(f"C_{system.letters[0]}_of_{system.names[i]}", own - rest))
    return [head, *later]
