# SPDX-License-Identifier: Apache-2.0
r"""Spatial chains of revolute and prismatic joints in symbols: kinematics and first moment.

Link 0 is the base; joint k, of position q_k, carries link k. The first moment of the chain in the
base frame is :math:`S = \sum_k m_k p_k + R_k h_k` with h_k = m_k c_k, exactly as
:mod:`comcal.statics.balance` has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.symbolic.algebra import Expr, Matrix, Symbol, sp


@dataclass(frozen=True)
class SpatialJoint:
    """A joint as constant numbers; its frame is parallel to the one before at q = 0.

    Parameters
    ----------
    name : str
    prismatic : bool
    p : sympy.Matrix, shape (3, 1)
        Its origin in the frame of the link before [m].
    axis : sympy.Matrix, shape (3, 1)
        Unit vector in the joint frame.
    link : str
        What the joint carries.
    """

    name: str
    prismatic: bool
    p: Matrix
    axis: Matrix
    link: str


@dataclass(frozen=True)
class SpatialChain:
    """A base and joints in order.

    Parameters
    ----------
    base : str
    joints : tuple of SpatialJoint
    q : tuple of sympy.Symbol
        Joint positions [rad] or [m].
    m : tuple of sympy.Expr
        Mass of the base and of every link [kg].
    """

    base: str
    joints: tuple[SpatialJoint, ...]
    q: tuple[Symbol, ...]
    m: tuple[Expr, ...]

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the base and of every link."""
        return (self.base, *(joint.link for joint in self.joints))


def exact(value: float) -> Expr:
    """Return 0, 1, -1 or a half as such, any other number as a float.

    Parameters
    ----------
    value : float
    """
    halves = round(2 * float(value))
    if abs(2 * float(value) - halves) < 1e-9:
        return sp.Rational(halves, 2)
    return sp.Float(float(value))


def chain_from_axes(
    axes: Sequence[npt.ArrayLike],
    offsets: Sequence[npt.ArrayLike],
    prismatic: Sequence[bool] = (),
    *,
    names: Sequence[str] = (),
    links: Sequence[str] = (),
    masses: Sequence[float] = (),
) -> SpatialChain:
    """Return a chain by its axes as they lie when all joint positions are zero.

    All frames are parallel to that of the base then, and each has its origin at its joint.

    Parameters
    ----------
    axes : sequence of array, shape (3,)
        Direction of every joint; normalised here.
    offsets : sequence of array, shape (3,)
        From the joint before, or from the base's origin, to the joint [m].
    prismatic : sequence of bool
        Which joints slide; none where it is empty.
    names, links : sequence of str
        Of the joints; of the base and of what each joint carries.
    masses : sequence of float
        Of the base and of every link [kg]; symbols where it is empty.
    """
    n = len(axes)
    slides = prismatic or [False] * n
    names = names or [f"q_{k + 1}" for k in range(n)]
    links = links or ["base", *(f"link_{k + 1}" for k in range(n))]
    joints: list[SpatialJoint] = []
    for k in range(n):
        unit = np.asarray(axes[k], dtype=np.float64)
        joints.append(
            SpatialJoint(
                names[k],
                slides[k],
                _column(offsets[k]),
                _column(unit / np.linalg.norm(unit)),
                links[k + 1],
            )
        )
    q = tuple(sp.Symbol(f"q_{k}", real=True) for k in range(1, n + 1))
    m = tuple(sp.Symbol(f"m_{k}", real=True) for k in range(n + 1))
    return SpatialChain(links[0], tuple(joints), q, tuple(map(exact, masses)) or m)


def _column(values: npt.ArrayLike) -> Matrix:
    return sp.Matrix([exact(x) for x in np.asarray(values, dtype=np.float64).tolist()])


def turning_positions(chain: SpatialChain) -> list[Symbol]:
    """Return the positions of those joints that turn."""
    return [q for q, joint in zip(chain.q, chain.joints, strict=True) if not joint.prismatic]


def place(chain: SpatialChain) -> list[tuple[Matrix, Matrix]]:
    """Return axes and origin of the base and of every link, in the base frame."""
    R, p = sp.eye(3), sp.zeros(3, 1)
    placed = [(R, p)]
    for joint, q in zip(chain.joints, chain.q, strict=True):
        p = p + R * joint.p
        if joint.prismatic:
            p = p + R * joint.axis * q
        else:
            R = R * turn(joint.axis, q)
        placed.append((R, p))
    return placed


def turn(axis: Matrix, angle: Expr) -> Matrix:
    """Return the rotation by *angle* about a unit axis (Rodrigues).

    Parameters
    ----------
    axis : sympy.Matrix, shape (3, 1)
    angle : sympy.Expr
        [rad]
    """
    x, y, z = axis
    K = sp.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return sp.eye(3) + sp.sin(angle) * K + (1 - sp.cos(angle)) * K * K


def first_moment(chain: SpatialChain, h: Sequence[Matrix]) -> Matrix:
    """Return the first moment of base and links in the base frame [kg m].

    Parameters
    ----------
    chain : SpatialChain
    h : sequence of sympy.Matrix, shape (3, 1)
        m_k c_k in the frame of the base and of every link [kg m].
    """
    terms = [m * p + R * moment for m, (R, p), moment in zip(chain.m, place(chain), h, strict=True)]
    return sum(terms, sp.zeros(3, 1))
