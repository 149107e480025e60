# SPDX-License-Identifier: Apache-2.0
r"""First-order uncertainty of the first moments of a spatial chain, from that of the total CoMs.

All unknowns are linear in the CoMs, whose components are taken as independent, so
:math:`\sigma^2(s) = \sum_{i, a} (\partial s / \partial com_{i a})^2\,\sigma^2(com_{i a})`. Masses
and lengths are taken as true.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from comcal.symbolic.algebra import Expr, Matrix, sp
from comcal.symbolic.inverse import inverse_by_minors
from comcal.symbolic.nullspace import ROUNDING, Visible, across_of, mass_quantities, visible
from comcal.symbolic.one_joint import inverse_turn
from comcal.symbolic.program import Program, Quantity, Steps, matrix
from comcal.symbolic.real_form import split
from comcal.symbolic.spatial import SpatialChain
from comcal.symbolic.spatial_choice import solvable_system, undetermined
from comcal.symbolic.spatial_one_joint import one_joint_shapes
from comcal.symbolic.spatial_places import AXIS_NAMES
from comcal.symbolic.spatial_results import combination_outputs
from comcal.symbolic.spatial_statements import sigma_statements
from comcal.symbolic.spatial_system import Shapes

Factors = list[list[Matrix]]
"""ds/dcom_i, a row vector per combination and configuration [kg]."""


def spatial_one_joint_sigma(chain: SpatialChain) -> Program:
    """Return the sigmas of the combinations when one joint is moved at a time.

    Parameters
    ----------
    chain : SpatialChain
    """
    found, steps = visible(chain), Steps()
    n = len(chain.joints)
    m_total = steps.let("m_total", sp.Add(*chain.m), real=True)
    across = [_rows([c.direction for c in across_of(found, k)]) for k in range(n + 1)]
    direct = [m_total * across[0]] + [sp.zeros(0, 3)] * n
    for v, (joint, q) in enumerate(zip(chain.joints, chain.q, strict=True), start=1):
        if not joint.prismatic:
            half = steps.let(f"half_{v}", sp.sin(q / 2), real=True)
            re, im = split(inverse_turn(q, half), {})
            cot = steps.let(f"cot_{v}", -im, real=True)
            turned = m_total * sp.Matrix([[re, cot], [-cot, re]]) * across[v]
            direct[v] = _named(f"S_{v}", turned, steps)
    through = _through(across)
    factors: Factors = []
    for k in range(n + 1):
        for row in range(across[k].rows):
            by = [through[k][i][row, :] * direct[i] for i in range(n + 1)]
            factors.append([by[0] - sum(by[1:], sp.zeros(1, 3)), *by[1:]])
    names = [str(i) for i in range(n + 1)]
    return _program(chain, found, names, factors, (one_joint_shapes(chain).q,), steps)


def spatial_cramer_sigma(chain: SpatialChain, shapes: Shapes | None = None) -> Program:
    """Return the sigmas of the combinations in any configurations.

    Parameters
    ----------
    chain : SpatialChain
    shapes : Shapes or None
        As for :func:`~comcal.symbolic.spatial_cramer.spatial_cramer_program`.

    Raises
    ------
    RankError
        If the configurations do not determine the combinations for any values of their names.
    UsageError
        If there are too many joints for a formula.
    """
    steps = Steps()
    system, solving, _ = solvable_system(chain, shapes, steps)
    rows = [system.entries(row, steps) for row in solving]
    inverted = inverse_by_minors(rows, [c.mark for c in system.unknowns], steps)
    if inverted is None:
        raise undetermined(system, "the determinant is zero for all values")
    n = len(system.shapes.names)
    later: Factors = []
    for c, inverse in zip(system.unknowns, inverted[0], strict=True):
        by = [sp.zeros(1, 3)] * n
        for row, value in zip(solving, inverse, strict=True):
            by[row.i] += system.m_total * value * row.direction.T
        by = [
            _named(f"C_{c.mark}_of_{name}", x, steps)
            for name, x in zip(system.shapes.names, by, strict=True)
        ]
        later.append([-sum(by[1:], sp.zeros(1, 3)), *by[1:]])
    head: Factors = []
    for i in range(3):
        own = [system.m_total * sp.eye(3)[i, :], *[sp.zeros(1, 3)] * (n - 1)]
        for by, column in zip(later, system.columns[0], strict=True):
            own = [x - column[i] * y for x, y in zip(own, by, strict=True)]
        head.append(own)
    inputs = system.shapes.inputs
    return _program(chain, system.found, system.shapes.names, [*head, *later], inputs, steps)


def _rows(directions: Sequence[Matrix]) -> Matrix:
    """Return directions as the rows of a matrix, which may have none."""
    return sp.Matrix(len(directions), 3, [x for d in directions for x in d])


def _through(across: Sequence[Matrix]) -> list[list[Matrix]]:
    """Return how the combinations of link k depend on S_i of link i, as numbers."""
    size = len(across)
    through = [[sp.zeros(a.rows, b.rows) for b in across] for a in across]
    for k in reversed(range(size)):
        through[k][k] = sp.eye(across[k].rows)
        for i in range(k + 1, size):
            farther = [across[j].T * through[j][i] for j in range(k + 1, i + 1)]
            value = -across[k] * sum(farther, sp.zeros(3, across[i].rows))
            through[k][i] = sp.Matrix(
                value.rows, value.cols, [x if abs(x) > ROUNDING else 0 for x in value]
            )
    return through


def _program(
    chain: SpatialChain,
    found: Visible,
    names: Sequence[str],
    factors: Factors,
    inputs: Sequence[Quantity],
    steps: Steps,
) -> Program:
    noise = matrix(
        "sigma_com", names, AXIS_NAMES, "standard error of x, y, z of each configuration's CoM", "m"
    )
    sigmas: list[Expr] = []
    for c, by in zip(found.combinations, factors, strict=True):
        terms: list[Expr] = []
        for i, (name, row) in enumerate(zip(names, by, strict=True)):
            for t, a in enumerate(AXIS_NAMES):
                factor = steps.let(f"ds_{c.mark}_{name}_{a}", row[t], real=True)
                terms.append(factor**2 * noise.symbols[3 * i + t] ** 2)
        sigmas.append(sp.sqrt(steps.let(f"v_{c.mark}", sp.Add(*terms), real=True)))
    outputs = tuple(
        replace(
            o,
            name=f"sigma_{o.name}",
            labels=tuple(f"sigma_{label}" for label in o.labels),
            meaning=f"standard deviation of {o.meaning}",
        )
        for o in combination_outputs(chain, found, sigmas)
        if o.values
    )
    return Program(
        name="first_moment_sigmas",
        title=f"Uncertainty of the first moments of the chain {chain.base} to {chain.links[-1]}",
        inputs=(noise, *inputs, *mass_quantities(chain)),
        steps=tuple(steps.done),
        outputs=outputs,
        statements=sigma_statements(chain, found),
    ).only_used()


def _named(name: str, factors: Matrix, steps: Steps) -> Matrix:
    """Return a matrix with a step for every entry."""
    named = sp.zeros(factors.rows, 3)
    for i in range(factors.rows):
        for t, a in enumerate(AXIS_NAMES):
            mark = f"{name}_{i + 1}_{a}" if factors.rows > 1 else f"{name}_{a}"
            named[i, t] = steps.let(mark, factors[i, t], real=True)
    return named
