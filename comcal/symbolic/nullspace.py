# SPDX-License-Identifier: Apache-2.0
r"""What static data say about a spatial chain, and what they cannot: the null space in symbols.

The first moment is linear in h_0 .. h_n. With frames that are
parallel at q = 0, :math:`R_k a_k = R_{k-1} a_k` along the axis a_k of a revolute joint, for every
q_k: that component of h_k cannot be told from the same of h_{k-1}. Of a prismatic joint no
component can. The component goes over to the link before, from the tip to the base, and what
remains is identifiable by configurations that are rich enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.algebra import Expr, Matrix, sp
from comcal.symbolic.program import Output, Program, Quantity, Statement, Steps
from comcal.symbolic.spatial import SpatialChain, place
from comcal.symbolic.spatial_places import AXIS_NAMES, named_places

ROUNDING = 1e-12
"""Factors below this are zero but for rounding [1]."""


@dataclass(frozen=True)
class Combination:
    """One number that static data determine.

    Parameters
    ----------
    label : str
        Its symbol.
    k : int
        0 for the base, else the number of the joint that carries the link.
    link : str
        The link in whose frame it stands.
    direction : sympy.Matrix, shape (3, 1)
        The component of that link's h.
    meaning : sympy.Expr
        The combination of components of h that is meant [kg m].
    """

    label: str
    k: int
    link: str
    direction: Matrix
    meaning: Expr

    @property
    def mark(self) -> str:
        """The label without what all labels share, for the names of steps."""
        return self.label[2:].replace("_", "")


@dataclass(frozen=True)
class Visible:
    """The null space of a chain and its complement.

    Parameters
    ----------
    h : tuple of sympy.Matrix
        Symbols of the unknowns m_k c_k [kg m].
    null : sympy.Matrix, shape (3 (n + 1), n_null)
        A column per direction that no pose sees.
    combinations : tuple of Combination
        From the base to the tip.
    """

    h: tuple[Matrix, ...]
    null: Matrix
    combinations: tuple[Combination, ...]


def visible(chain: SpatialChain) -> Visible:
    """Return what configurations of all kinds determine of a chain, and what none does."""
    n = len(chain.joints)
    h = tuple(
        sp.Matrix([sp.Symbol(f"h_{k}{axis}", real=True) for axis in AXIS_NAMES])
        for k in range(n + 1)
    )
    columns: list[Matrix] = []
    # Factors of all unknowns in what has gathered at each link.
    merged = [
        sp.zeros(3, 3 * k).row_join(sp.eye(3)).row_join(sp.zeros(3, 3 * (n - k)))
        for k in range(n + 1)
    ]
    kept: list[list[Matrix]] = [[] for _ in range(n + 1)]
    for k in range(n, 0, -1):
        joint = chain.joints[k - 1]
        lost = [sp.eye(3)[:, i] for i in range(3)] if joint.prismatic else [joint.axis]
        kept[k] = [] if joint.prismatic else across(joint.axis)
        for direction in lost:
            column = sp.zeros(3 * (n + 1), 1)
            column[3 * k : 3 * k + 3, 0] = direction
            column[3 * k - 3 : 3 * k, 0] = -direction
            columns.append(column)
            merged[k - 1] += direction * (direction.T * merged[k])
    kept[0] = [sp.eye(3)[:, i] for i in range(3)]
    combinations = tuple(
        Combination(f"s_{k}_{i + 1}", k, chain.links[k], d, _sum(d.T * merged[k], h))
        for k in range(n + 1)
        for i, d in enumerate(kept[k])
    )
    return Visible(h, sp.Matrix.hstack(*reversed(columns)), combinations)


def _sum(factors: Matrix, h: Sequence[Matrix]) -> Expr:
    """Return a sum of unknowns, without the terms that rounding left."""
    terms = zip(factors, sp.Matrix.vstack(*h), strict=True)
    return sp.Add(*(factor * symbol for factor, symbol in terms if abs(factor) > ROUNDING))


def across(axis: Matrix) -> list[Matrix]:
    """Return two unit vectors that are a right-handed frame with *axis* as the third.

    Parameters
    ----------
    axis : sympy.Matrix, shape (3, 1)
        Unit vector.
    """
    along = [i for i in range(3) if axis[i] != 0]
    if len(along) == 1:
        plane = [sp.eye(3)[:, (along[0] + i) % 3] for i in (1, 2)]
        return plane if axis[along[0]] > 0 else plane[::-1]
    smallest = min(range(3), key=lambda i: abs(float(axis[i])))
    first = axis.cross(sp.eye(3)[:, smallest])
    first = first / sp.sqrt(first.dot(first))
    return [first, axis.cross(first)]


def harmonics(chain: SpatialChain) -> Array:
    """Return the regressor of h as constants, one row per component and product of sines, cosines.

    The products of 1, cos q_k and sin q_k over all joints are linearly independent functions, so
    this matrix has the null space that all configurations together have.
    """
    n = len(chain.joints)
    c = [sp.Symbol(f"c_{k}") for k in range(n)]
    s = [sp.Symbol(f"s_{k}") for k in range(n)]
    plain = {sp.cos(q): c[k] for k, q in enumerate(chain.q)}
    plain |= {sp.sin(q): s[k] for k, q in enumerate(chain.q)}
    regressor = sp.Matrix.hstack(*(R for R, _ in place(chain))).xreplace(plain)
    rows: dict[tuple[int, tuple[int, ...]], list[float]] = {}
    for i in range(3):
        for column in range(3 * (n + 1)):
            for powers, value in sp.Poly(regressor[i, column], *c, *s).terms():
                row = rows.setdefault((i, powers), [0.0] * (3 * (n + 1)))
                row[column] = float(value)
    return np.array(list(rows.values()))


def across_of(found: Visible, k: int) -> list[Combination]:
    """Return the combinations of one link: across the axis of its joint, or of the base all three.

    Parameters
    ----------
    found : Visible
    k : int
        0 for the base.
    """
    return [c for c in found.combinations if c.k == k]


def visible_statements(found: Visible) -> tuple[Statement, ...]:
    """Return the names of what can be identified, and of what cannot.

    Parameters
    ----------
    found : Visible
    """
    statements = [
        Statement(
            f"{len(found.combinations)} combinations of {3 * len(found.h)} first moments "
            "h_k = m_k c_k are identifiable, each in the frame of its link; enough poses determine "
            "them all. That frame has its origin at the link's joint and, with all joints at zero, "
            "the axes of the base."
        )
    ]
    statements += [
        Statement(f"In the frame of {c.link}.", sp.Symbol(c.label), c.meaning)
        for c in found.combinations
    ]
    statements.append(
        Statement(f"{found.null.shape[1]} directions change no total CoM in any pose:")
    )
    unknown = sp.Matrix.vstack(*found.h)
    for column in range(found.null.shape[1]):
        direction = found.null[:, column]
        moved = [str(x) for x, d in zip(unknown, direction, strict=True) if d != 0]
        statements.append(
            Statement(
                f"together {', '.join(moved)}:", sp.Symbol("direction"), direction.dot(unknown)
            )
        )
    return tuple(statements)


def mass_quantities(chain: SpatialChain) -> tuple[Quantity, ...]:
    """Return those masses of a chain that are symbols, as inputs.

    Parameters
    ----------
    chain : SpatialChain
    """
    return tuple(
        Quantity(str(m), (m,), (), f"mass of {link}", "kg")
        for m, link in zip(chain.m, chain.links, strict=True)
        if m.is_Symbol
    )


def spatial_program(chain: SpatialChain) -> Program:
    """Return the equations of one pose for the identifiable combinations, and what these mean.

    Notes
    -----
    One pose gives three equations, ``rows @ s = rhs``. Stack those of enough poses and solve them
    in the least-squares sense.
    """
    found = visible(chain)
    n = len(chain.joints)
    q = Quantity("q", chain.q, (n,), f"joints {', '.join(j.name for j in chain.joints)}", "rad|m")
    com = tuple(sp.Symbol(f"com_{a}", real=True) for a in AXIS_NAMES)
    given = Quantity("com", com, (3,), f"total CoM in the frame of {chain.base}", "m")
    steps = Steps()
    placed = named_places(chain, chain.q, steps)
    rows: list[Expr] = []
    rhs: list[Expr] = []
    for i in range(3):
        rows += [(placed[c.k][0][i, :] * c.direction)[0, 0] for c in found.combinations]
        lengths = sp.Add(*(mass * p[i] for mass, (_, p) in zip(chain.m, placed, strict=True)))
        rhs.append(sp.Add(*chain.m) * com[i] - lengths)
    labels = tuple(f"row_{a}_{c.label}" for a in AXIS_NAMES for c in found.combinations)
    words = f"3 x {len(found.combinations)}, row by row: x, y, z of the first moment, " + ", ".join(
        c.label for c in found.combinations
    )
    outputs = (
        Output("rows", labels, tuple(rows), True, words, "1"),
        Output(
            "rhs", tuple(f"rhs_{a}" for a in AXIS_NAMES), tuple(rhs), True, "their sums", "kg m"
        ),
    )
    return Program(
        name="first_moment_rows",
        title=f"What static data see of the chain {chain.base} to {chain.links[-1]}",
        inputs=(q, given, *mass_quantities(chain)),
        steps=tuple(steps.done),
        outputs=outputs,
        statements=visible_statements(found),
    ).only_used()
