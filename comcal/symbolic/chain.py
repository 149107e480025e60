# SPDX-License-Identifier: Apache-2.0
r"""The planar chain of Muscolo 2017 for any number of links, in symbols.

Frame P, z + j x with j^2 = -1. The foot stands still: m_u, CoM l_u + j r_u. Above it n segments,
each turned by its absolute pitch :math:`\varphi_v` (positive to the toes) from the straight
posture: the first begins at the ankle U + j A, the next at the end L_v + j D_v of the one before;
its CoM is w_v = l_v + j r_v from where it begins. The first moment about P is

.. math::

   m_2 (Z + j X) = m_u (l_u + j r_u) + m_w (U + j A)
     + \sum_v [m_v (l_v + j r_v) + (L_v + j D_v) \sum_{k>v} m_k] e^{j \varphi_v}

(Muscolo 2017, (18)-(26), for A = D = 0 and n = 2). The bracket is one complex number per segment:
the statically equivalent serial chain of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.program import Quantity, scalar, vector

PAPER_LETTERS = "bcdefghi"
"""The paper calls the foot a and the segments above it b, c ..."""


@dataclass(frozen=True)
class Chain:
    """Symbols of a planar chain.

    Parameters
    ----------
    letters : tuple of str
        One per segment, from the ankle up.
    m : tuple of sympy.Expr
        Masses of the segments [kg].
    joints : tuple of sympy.Expr
        L_v + j D_v of all segments but the last [m].
    foot : sympy.Expr
        m_u (l_u + j r_u) [kg m].
    ankle : sympy.Expr
        U + j A [m].
    m_u : sympy.Expr
        [kg]
    inputs : tuple of Quantity
        What the expressions are made of.
    """

    letters: tuple[str, ...]
    m: tuple[Expr, ...]
    joints: tuple[Expr, ...]
    foot: Expr
    ankle: Expr
    m_u: Expr
    inputs: tuple[Quantity, ...]

    @property
    def m_w(self) -> Expr:
        """Mass above the ankle [kg]."""
        return sp.Add(*self.m)

    @property
    def m_2(self) -> Expr:
        """Mass of everything that is carried, equation (18) [kg]."""
        return sp.Add(self.m_u, *self.m)

    @property
    def levers(self) -> tuple[Expr, ...]:
        """First moment of what a segment carries at its end, (L_v + j D_v) sum m_k [kg m]."""
        above = [sp.Add(*self.m[v + 1 :]) for v in range(len(self.joints))]
        carried = [L * m for L, m in zip(self.joints, above, strict=True)]
        return (*carried, sp.Integer(0))


def letters_of(n: int) -> tuple[str, ...]:
    """Return a name for each of *n* segments: the paper's letters, or numbers where they end."""
    if n <= len(PAPER_LETTERS):
        return tuple(PAPER_LETTERS[:n])
    return tuple(str(v + 1) for v in range(n))


def planar_chain(n: int, *, offsets: bool = False) -> Chain:
    """Return the symbols of a planar chain of *n* segments above the ankle.

    Parameters
    ----------
    n : int
        1 or more.
    offsets : bool
        Whether joints may lie beside the line between their neighbours (A and D_v); the paper's
        do not.
    """
    letters = letters_of(n)
    m = vector("m", letters, "masses of the segments, from the ankle up", "kg")
    m_u = scalar("m_u", "mass of what stays on the ground with the feet", "kg")
    r_u = scalar("r_u", "x of its CoM in P", "m")
    l_u = scalar("l_u", "z of its CoM in P", "m")
    U = scalar("U", "z of the ankle axis in P", "m")
    A = scalar("A", "x of the ankle axis in P", "m")
    L = vector("L", letters[:-1], "z from each segment's joint to the next, standing straight", "m")
    D = vector("D", letters[:-1], "x from each segment's joint to the next, standing straight", "m")
    across = [sp.I * d if offsets else sp.Integer(0) for d in D.symbols]
    return Chain(
        letters=letters,
        m=m.symbols,
        joints=tuple(along + d for along, d in zip(L.symbols, across, strict=True)),
        foot=m_u.symbols[0] * (l_u.symbols[0] + sp.I * r_u.symbols[0]),
        ankle=U.symbols[0] + (sp.I * A.symbols[0] if offsets else 0),
        m_u=m_u.symbols[0],
        inputs=(m, L, D, m_u, r_u, l_u, U, A),
    )


def first_moment(chain: Chain, angles: Sequence[Expr], w: Sequence[Expr]) -> Expr:
    """Return m_2 (Z + j X) of one posture, joint by joint as the kinematics place them.

    Parameters
    ----------
    chain : Chain
    angles : sequence of sympy.Expr
        Absolute pitch of every segment [rad].
    w : sequence of sympy.Expr
        l_v + j r_v of every segment [m].
    """
    at, total = chain.ankle, chain.foot
    for v, (m, phi) in enumerate(zip(chain.m, angles, strict=True)):
        turn = sp.exp(sp.I * phi)
        total += m * (at + w[v] * turn)
        if v < len(chain.joints):
            at += chain.joints[v] * turn
    return total
