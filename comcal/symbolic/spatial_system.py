# SPDX-License-Identifier: Apache-2.0
r"""The first moments of a spatial chain in any configurations as one linear system.

With :math:`b_i = m\,com_i - \sum_k m_k p_k(q_i)` and the combinations s of
:mod:`comcal.symbolic.nullspace`, :math:`\sum_k R_k(q_i) D_k s_k = b_i`. The base does not turn, so
configuration 0 gives :math:`s_0`, and the differences

.. math:: \sum_{k \ge 1} [R_k(q_i) - R_k(q_0)]\,D_k\,s_k = b_i - b_0

the rest: two unknowns per turning joint.
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal.symbolic.algebra import Expr, Matrix, sp
from comcal.symbolic.nullspace import Combination, Visible, mass_quantities, visible
from comcal.symbolic.program import Quantity, Steps, matrix
from comcal.symbolic.spatial import SpatialChain, turning_positions
from comcal.symbolic.spatial_places import AXIS_NAMES, named_places


@dataclass(frozen=True)
class Shapes:
    """Configurations of a spatial chain.

    Parameters
    ----------
    names : tuple of str
    positions : tuple of tuple of sympy.Expr
        Of all joints, a row per configuration [rad] or [m].
    inputs : tuple of Quantity
        What the positions are made of.
    """

    names: tuple[str, ...]
    positions: tuple[tuple[Expr, ...], ...]
    inputs: tuple[Quantity, ...]


@dataclass(frozen=True)
class Row:
    """One equation: a component of configuration *i* less that of the first.

    Parameters
    ----------
    name, words : str
        For formulas and for the reader.
    i : int
        1 or more.
    direction : sympy.Matrix, shape (3, 1)
        In the base frame.
    """

    name: str
    words: str
    i: int
    direction: Matrix


@dataclass(frozen=True)
class SpatialSystem:
    """What all configurations say, written in steps.

    Parameters
    ----------
    chain : SpatialChain
    found : Visible
    shapes : Shapes
    m_total : sympy.Expr
        [kg]
    unknowns : tuple of Combination
        All but those of the base.
    columns : tuple of tuple of sympy.Matrix
        R_k d of every unknown, a row per configuration.
    b : tuple of sympy.Matrix
        First moment without the known lengths, per configuration [kg m].
    inputs : tuple of Quantity
    """

    chain: SpatialChain
    found: Visible
    shapes: Shapes
    m_total: Expr
    unknowns: tuple[Combination, ...]
    columns: tuple[tuple[Matrix, ...], ...]
    b: tuple[Matrix, ...]
    inputs: tuple[Quantity, ...]

    def entries(self, row: Row, steps: Steps) -> list[Expr]:
        """Return the factors of the unknowns in one equation, named."""
        return [
            steps.let(f"A_{row.name}_{c.mark}", row.direction.dot(at - first), real=True)
            for c, at, first in zip(
                self.unknowns, self.columns[row.i], self.columns[0], strict=True
            )
        ]

    def rhs(self, row: Row, steps: Steps) -> Expr:
        """Return the right-hand side of one equation, named [kg m]."""
        value = row.direction.dot(self.b[row.i] - self.b[0])
        return steps.let(f"B_{row.name}", value, real=True)


def free_shapes(chain: SpatialChain) -> Shapes:
    """Return configurations in which every position is free: one more than joints that turn."""
    n = len(chain.joints)
    names = [str(i) for i in range(1 + len(turning_positions(chain)))]
    joints = ", ".join(joint.name for joint in chain.joints)
    q = matrix(
        "q",
        names,
        [str(k) for k in range(1, n + 1)],
        f"position of every joint in configurations 0 to {names[-1]}: {joints}",
        "rad|m",
    )
    rows = tuple(q.symbols[i * n : (i + 1) * n] for i in range(len(names)))
    return Shapes(tuple(names), rows, (q,))


def spatial_system(chain: SpatialChain, shapes: Shapes, steps: Steps) -> SpatialSystem:
    """Write the equations of some configurations.

    Parameters
    ----------
    chain : SpatialChain
    shapes : Shapes
    steps : Steps
        The steps are added to it.
    """
    found = visible(chain)
    unknowns = tuple(c for c in found.combinations if c.k > 0)
    names = ", ".join(shapes.names)
    com = matrix(
        "com",
        shapes.names,
        AXIS_NAMES,
        f"total CoM of configurations {names}, in the frame of {chain.base}",
        "m",
    )
    m_total = steps.let("m_total", sp.Add(*chain.m), real=True)
    columns: list[tuple[Matrix, ...]] = []
    b: list[Matrix] = []
    for i, (name, positions) in enumerate(zip(shapes.names, shapes.positions, strict=True)):
        placed = named_places(chain, positions, steps, name)
        columns.append(
            tuple(
                _named(f"d_{name}_{c.mark}", placed[c.k][0] * c.direction, steps) for c in unknowns
            )
        )
        lengths = sum((m * p for m, (_, p) in zip(chain.m, placed, strict=True)), sp.zeros(3, 1))
        given = sp.Matrix(com.symbols[3 * i : 3 * i + 3])
        b.append(_named(f"b_{name}", m_total * given - lengths, steps))
    inputs = (com, *shapes.inputs, *mass_quantities(chain))
    return SpatialSystem(chain, found, shapes, m_total, unknowns, tuple(columns), tuple(b), inputs)


def rows_across(system: SpatialSystem) -> tuple[list[Row], list[Row]]:
    """Return the equations that solve free configurations, and those that are left.

    Of configuration v the two components across the axis of the v-th turning joint solve: when
    only that joint is turned, they are the ones that change. The one along the axis is left.

    Parameters
    ----------
    system : SpatialSystem
        Of :func:`free_shapes`.
    """
    solving: list[Row] = []
    left: list[Row] = []
    turning = [k for k, joint in enumerate(system.chain.joints, 1) if not joint.prismatic]
    for i, k in enumerate(turning, start=1):
        name = system.shapes.names[i]
        across = [c for c in system.unknowns if c.k == k]
        words = f"configuration {name} across a_{k}"
        solving += [
            Row(f"{name}_{t}", words, i, c.direction) for t, c in enumerate(across, start=1)
        ]
        axis = system.chain.joints[k - 1].axis
        left.append(Row(f"{name}_3", f"configuration {name} along a_{k}", i, axis))
    return solving, left


def all_rows(system: SpatialSystem) -> list[Row]:
    """Return x, y and z of every configuration but the first.

    Parameters
    ----------
    system : SpatialSystem
    """
    return [
        Row(f"{name}_{a}", f"{a} of {name}", i, sp.eye(3)[:, t])
        for i, name in enumerate(system.shapes.names)
        if i > 0
        for t, a in enumerate(AXIS_NAMES)
    ]


def _named(name: str, vector: Matrix, steps: Steps) -> Matrix:
    return sp.Matrix(
        [steps.let(f"{name}_{a}", x, real=True) for a, x in zip(AXIS_NAMES, vector, strict=True)]
    )
