# SPDX-License-Identifier: Apache-2.0
r"""What static data say about a spatial chain, and what they cannot: the null space in symbols.

The first moment is linear in h_0 .. h_n. With frames that are
parallel at q = 0, :math:`R_k a_k = R_{k-1} a_k` along the axis a_k of a revolute joint, for every
q_k: that component of h_k cannot be told from the same of h_{k-1}. Of a prismatic joint no
component can. The component goes over to the link before, from the tip to the base, and what
remains is identifiable by configurations that are rich enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.errors import UsageError
from comcal.robot.tree import Array
from comcal.symbolic.algebra import Expr, Matrix, sp
from comcal.symbolic.program import Output, Program, Quantity, Statement, Steps
from comcal.symbolic.spatial import SpatialChain, place

MAX_JOINTS = 4
"""The products of sines and cosines triple with every joint."""
AXIS_NAMES = ("x", "y", "z")


@dataclass(frozen=True)
class Combination:
    """One number that static data determine.

    Parameters
    ----------
    label : str
        Its symbol.
    link : str
        The link in whose frame it stands.
    direction : sympy.Matrix, shape (3, 1)
        The component of that link's h.
    meaning : sympy.Expr
        The combination of components of h that is meant [kg m].
    """

    label: str
    link: str
    direction: Matrix
    meaning: Expr


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
    """

    h: tuple[Matrix, ...]
    null: Matrix
    combinations: tuple[Combination, ...]


def visible(chain: SpatialChain) -> Visible:
    """Return what configurations of all kinds determine of a chain, and what none does.

    Raises
    ------
    UsageError
        If there are more than ``MAX_JOINTS`` joints.
    """
    n = len(chain.joints)
    if n > MAX_JOINTS:
        raise UsageError(
            "the symbolic null space is for short chains",
            measured=f"{n} joints",
            limit=f"{MAX_JOINTS}",
            next_step="choose --base and --tip closer together; comcal solve has no such limit",
        )
    h = tuple(
        sp.Matrix([sp.Symbol(f"h_{k}{axis}", real=True) for axis in AXIS_NAMES])
        for k in range(n + 1)
    )
    columns: list[Matrix] = []
    merged = list(h)
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
            merged[k - 1] = merged[k - 1] + direction * direction.dot(merged[k])
    kept[0] = [sp.eye(3)[:, i] for i in range(3)]
    combinations = tuple(
        Combination(f"s_{k}_{i + 1}", chain.links[k], d, sp.expand(d.dot(merged[k])))
        for k in range(n + 1)
        for i, d in enumerate(kept[k])
    )
    return Visible(h, sp.Matrix.hstack(*reversed(columns)), combinations)


def across(axis: Matrix) -> list[Matrix]:
    """Return two unit vectors that are orthogonal to *axis* and to one another.

    Parameters
    ----------
    axis : sympy.Matrix, shape (3, 1)
        Unit vector.
    """
    along = [i for i in range(3) if axis[i] != 0]
    if len(along) == 1:
        return [sp.eye(3)[:, i] for i in range(3) if i not in along]
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
    free = sorted({x for m in chain.m for x in m.free_symbols}, key=str)
    m = [Quantity(str(x), (x,), (), f"mass of {chain.links[int(str(x)[2:])]}", "kg") for x in free]
    steps = Steps()
    placed = _named_places(chain, steps)
    order = [chain.links.index(c.link) for c in found.combinations]
    rows: list[Expr] = []
    rhs: list[Expr] = []
    for i in range(3):
        for k, c in zip(order, found.combinations, strict=True):
            rows.append((placed[k][0][i, :] * c.direction)[0, 0])
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
    statements = [
        Statement(
            f"{len(found.combinations)} combinations of {3 * (n + 1)} first moments h_k = m_k c_k "
            "are identifiable, each in the frame of its link; enough poses determine them all."
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
    return Program(
        name="first_moment_rows",
        title=f"What static data see of the chain {chain.base} to {chain.links[-1]}",
        inputs=(q, given, *m),
        steps=tuple(steps.done),
        outputs=outputs,
        statements=tuple(statements),
    ).only_used()


def _named_places(chain: SpatialChain, steps: Steps) -> list[tuple[Matrix, Matrix]]:
    """Return the places of all links with every entry of a rotation and origin named."""
    cosines = {}
    for k, q in enumerate(chain.q, start=1):
        if not chain.joints[k - 1].prismatic:
            cosines[sp.cos(q)] = steps.let(f"c_{k}", sp.cos(q), real=True)
            cosines[sp.sin(q)] = steps.let(f"s_{k}", sp.sin(q), real=True)
    placed: list[tuple[Matrix, Matrix]] = [(sp.eye(3), sp.zeros(3, 1))]
    for k, joint in enumerate(chain.joints, start=1):
        R, p = placed[-1]
        own = SpatialChain(chain.base, (joint,), (chain.q[k - 1],), chain.m[:2])
        R_own, p_own = (m.xreplace(cosines) for m in place(own)[1])
        R_k, p_k = (R * R_own), p + R * p_own
        R_named, p_named = sp.zeros(3, 3), sp.zeros(3, 1)
        for i, a in enumerate(AXIS_NAMES):
            p_named[i] = steps.let(f"p_{k}_{a}", p_k[i], real=True)
            for j, b in enumerate(AXIS_NAMES):
                R_named[i, j] = steps.let(f"R_{k}_{a}{b}", R_k[i, j], real=True)
        placed.append((R_named, p_named))
    return placed
