# SPDX-License-Identifier: Apache-2.0
"""Cramer's rule for a spatial chain in any configurations, as a straight line of small steps."""

from __future__ import annotations

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.minors import cramer_by_minors
from comcal.symbolic.nullspace import across_of
from comcal.symbolic.program import Program, Steps
from comcal.symbolic.spatial import SpatialChain
from comcal.symbolic.spatial_choice import solvable_system, undetermined
from comcal.symbolic.spatial_results import (
    combination_outputs,
    determinant_output,
    misfit_output,
)
from comcal.symbolic.spatial_statements import free_statements
from comcal.symbolic.spatial_system import Shapes


def spatial_cramer_program(chain: SpatialChain, shapes: Shapes | None = None) -> Program:
    """Return the identifiable combinations by Cramer's rule.

    Parameters
    ----------
    chain : SpatialChain
    shapes : Shapes or None
        None: as many as joints that turn and one more, all positions free.

    Returns
    -------
    Program
        Outputs ``s`` [kg m]; ``c``, the CoM components that no other link shares [m]; ``misfit``
        of the equations that were not used [m]; ``determinant`` [1].

    Raises
    ------
    RankError
        If the configurations do not determine the combinations for any values of their names.
    UsageError
        If there are more than ``spatial_choice.MAX_JOINTS`` joints.
    """
    steps = Steps()
    system, solving, left = solvable_system(chain, shapes, steps)
    solved = cramer_by_minors(
        [system.entries(row, steps) for row in solving],
        [system.rhs(row, steps) for row in solving],
        [c.mark for c in system.unknowns],
        [c.label for c in system.unknowns],
        steps,
        real=True,
    )
    if solved is None:
        raise undetermined(system, "the determinant is zero for all values")
    later, det = solved
    s: list[Expr] = []
    for i, c in enumerate(across_of(system.found, 0)):
        known = sp.Add(*(x * column[i] for x, column in zip(later, system.columns[0], strict=True)))
        s.append(steps.let(c.label, system.b[0][i] - known, real=True))
    s += later
    misfits: dict[str, Expr] = {}
    for row in left:
        predicted = sp.Add(*(a * x for a, x in zip(system.entries(row, steps), later, strict=True)))
        misfits[f"misfit_{row.name}"] = (predicted - system.rhs(row, steps)) / system.m_total
    outputs = [
        *combination_outputs(chain, system.found, s),
        misfit_output(misfits, "; ".join(row.words for row in left)),
        determinant_output(det),
    ]
    return Program(
        name="first_moments",
        title=f"First moments of the chain {chain.base} to {chain.links[-1]}, by Cramer's rule",
        inputs=system.inputs,
        steps=tuple(steps.done),
        outputs=tuple(o for o in outputs if o.values),
        statements=free_statements(system, solving),
    ).only_used()
