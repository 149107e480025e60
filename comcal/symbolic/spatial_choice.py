# SPDX-License-Identifier: Apache-2.0
"""Which equations of given configurations solve, and what to say when none do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from comcal.errors import RankError, UsageError
from comcal.robot.tree import Array
from comcal.symbolic.program import Output, Program, Steps
from comcal.symbolic.samples import sample_inputs
from comcal.symbolic.spatial import SpatialChain
from comcal.symbolic.spatial_system import (
    Row,
    Shapes,
    SpatialSystem,
    all_rows,
    free_shapes,
    rows_across,
    spatial_system,
)
from comcal.symbolic.to_python import python_function

MAX_JOINTS = 4
"""The minors quadruple with every joint: beyond this many, move one joint at a time."""
DEPENDENT = 1e-9
"""Singular values below this count as zero; the factors are sines and cosines [1]."""


def solvable_system(
    chain: SpatialChain, shapes: Shapes | None, steps: Steps
) -> tuple[SpatialSystem, list[Row], list[Row]]:
    """Write the equations of some configurations; return those that solve, and those left over.

    Parameters
    ----------
    chain : SpatialChain
    shapes : Shapes or None
        None: as many as joints that turn and one more, all positions free.
    steps : Steps
        The steps are added to it.

    Raises
    ------
    RankError
        If the configurations do not determine the combinations for any values of their names.
    UsageError
        If there are more than ``MAX_JOINTS`` joints.
    """
    n = len(chain.joints)
    if n > MAX_JOINTS:
        raise UsageError(
            "Cramer's rule for free configurations of a spatial chain is for short ones",
            measured=f"{n} joints",
            limit=f"{MAX_JOINTS}",
            next_step="use the configurations one-joint, whose formula is short for any number, "
            "or choose --base and --tip closer together",
        )
    system = spatial_system(chain, shapes or free_shapes(chain), steps)
    solving, left = rows_across(system) if shapes is None else independent_rows(system, steps)
    return system, solving, left


def independent_rows(system: SpatialSystem, steps: Steps) -> tuple[list[Row], list[Row]]:
    """Return as many equations as unknowns that do not follow from one another, and the others.

    They are chosen by numbers, at one example of the names in the configurations: what is
    independent there is so almost everywhere. Of many, those are taken that differ most.

    Parameters
    ----------
    system : SpatialSystem
    steps : Steps
        In which the system is written.

    Raises
    ------
    RankError
        If there are not as many.
    """
    rows, wanted = all_rows(system), len(system.unknowns)
    if not wanted:
        return [], rows
    if len(rows) < wanted:
        raise undetermined(system, f"{len(rows)} equations for {wanted} unknowns")
    values = _numbers(system, rows, steps)
    order = np.asarray(qr(values.T, mode="r", pivoting=True)[-1], np.intp)[:wanted]
    rank = int(np.linalg.matrix_rank(values[order], tol=DEPENDENT))
    if rank < wanted:
        raise undetermined(system, f"rank {rank} for {wanted} unknowns")
    chosen = set(order.tolist())
    return (
        [row for k, row in enumerate(rows) if k in chosen],
        [row for k, row in enumerate(rows) if k not in chosen],
    )


def undetermined(system: SpatialSystem, measured: str) -> RankError:
    """Return the error that says which joint to turn.

    Parameters
    ----------
    system : SpatialSystem
    measured : str
        What there is.
    """
    shapes = system.shapes
    still = [
        joint.name
        for k, joint in enumerate(system.chain.joints)
        if not joint.prismatic and len({row[k] for row in shapes.positions}) == 1
    ]
    return RankError(
        f"configurations {', '.join(shapes.names)} do not determine the first moments",
        measured=measured,
        limit=f"{len(system.unknowns)}",
        next_step=f"turn {', '.join(still)}, which stands still in all of them"
        if still
        else "add a shape in which one joint alone is turned, for every joint that turns",
    )


def _numbers(system: SpatialSystem, rows: Sequence[Row], steps: Steps) -> Array:
    """Return the factors of the unknowns in all equations at one example."""
    trial = Steps(list(steps.done))
    entries = [entry for row in rows for entry in system.entries(row, trial)]
    labels = tuple(str(k) for k in range(len(entries)))
    program = Program(
        name="rows",
        title="rows",
        inputs=system.inputs,
        steps=tuple(trial.done),
        outputs=(Output("rows", labels, tuple(entries), True, "rows", "1"),),
    ).only_used()
    found = python_function(program)(**sample_inputs(program.inputs))
    return np.asarray(found, dtype=np.float64).reshape(len(rows), -1)
