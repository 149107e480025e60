# SPDX-License-Identifier: Apache-2.0
r"""E G = K: the first moments of all configurations as one complex linear system.

:math:`E_{iv} = e^{j \varphi_{iv}}`; K_i is the first moment of configuration i without what stays
on the ground, G_v = m_v (l_v + j r_v) + (L_v + j D_v) sum of the masses beyond. K comes
out of the very function that the numeric code runs, :func:`comcal.statics.planar.moment_of_coms`,
given symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.statics.planar import moment_of_coms
from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.chain import Chain, letters_of
from comcal.symbolic.program import Quantity, matrix, scalar, vector

Angles = tuple[tuple[Expr, ...], ...]


@dataclass(frozen=True)
class System:
    """E G = K of some configurations.

    Parameters
    ----------
    letters, names : tuple of str
        Of the segments and of the configurations.
    angles : tuple of tuple of sympy.Expr
        phi_iv, a row per configuration [rad].
    K : tuple of sympy.Expr
        Right-hand side [kg m].
    levers : tuple of sympy.Expr
        Known part of each G_v [kg m].
    m : tuple of sympy.Expr
        Masses of the segments [kg].
    m_2 : tuple of sympy.Expr
        Mass of which each configuration's CoM speaks [kg].
    inputs : tuple of Quantity
    """

    letters: tuple[str, ...]
    names: tuple[str, ...]
    angles: Angles
    K: tuple[Expr, ...]
    levers: tuple[Expr, ...]
    m: tuple[Expr, ...]
    m_2: tuple[Expr, ...]
    inputs: tuple[Quantity, ...]

    def take(self, rows: Sequence[int]) -> System:
        """Return the system of some of the configurations."""
        return replace(
            self,
            names=tuple(self.names[i] for i in rows),
            angles=tuple(self.angles[i] for i in rows),
            K=tuple(self.K[i] for i in rows),
            m_2=tuple(self.m_2[i] for i in rows),
        )


def free_angles(n: int) -> tuple[Angles, Quantity]:
    """Return n configurations of n segments in which every angle is free."""
    letters = letters_of(n)
    phi = matrix("phi", letters, letters, "absolute pitch of segment v in configuration i", "rad")
    rows = [phi.symbols[i * n : (i + 1) * n] for i in range(n)]
    return tuple(rows), phi


def one_joint_angles(n: int) -> tuple[Angles, Quantity]:
    """Return n configurations that bend one joint at a time.

    The first is the straight shape tilted about the ankle by theta_1; in configuration v only
    joint v is bent, by theta_v, and turns segment v with all beyond it.
    """
    theta = vector("theta", letters_of(n), "bend of joint v in configuration v", "rad")
    zero = sp.Integer(0)
    rows = [tuple(theta.symbols[i] if v >= i else zero for v in range(n)) for i in range(n)]
    return tuple(rows), theta


def system_of(
    chain: Chain, angles: Angles, inputs: Sequence[Quantity], names: Sequence[str] = ()
) -> System:
    """Return the system of a chain whose total CoM (X_i, Z_i) in P is known.

    Parameters
    ----------
    chain : Chain
    angles : tuple of tuple of sympy.Expr
        A row per configuration [rad].
    inputs : sequence of Quantity
        What the angles are made of.
    names : sequence of str
        Of the configurations; the segments' letters where none are given.
    """
    names = tuple(names) or letters_of(len(angles))
    X = vector("X", names, "x of the total CoM in each configuration, in P", "m")
    Z = vector("Z", names, "z of the total CoM in each configuration, in P", "m")
    # With the levers among the unknowns, all that turns is counted from the ankle.
    m, ankle = (np.array([value], dtype=object) for value in (chain.m_w, chain.ankle))
    total = [
        moment_of_coms(chain.m_2 * (z + sp.I * x), chain.foot, m, ankle)
        for x, z in zip(X.symbols, Z.symbols, strict=True)
    ]
    return System(
        letters=chain.letters,
        names=names,
        angles=angles,
        K=tuple(total),
        levers=chain.levers,
        m=chain.m,
        m_2=(chain.m_2,) * len(angles),
        inputs=(X, Z, *inputs, *chain.inputs),
    )


def system_with_joints(n: int) -> System:
    """Return the system of any robot whose joints' places are given in every configuration.

    For trees with pairs of legs, whose lengths are not those of one chain. The foot's CoM and the
    carried mass may differ from one configuration to the next, as measured ones do.
    """
    letters = letters_of(n)
    angles, phi = free_angles(n)
    X = vector("X", letters, "x of the total CoM in each configuration, in P", "m")
    Z = vector("Z", letters, "z of the total CoM in each configuration, in P", "m")
    m_2 = vector("m_2", letters, "mass of which the total CoM speaks", "kg")
    m_u = scalar("m_u", "mass of what stays on the ground with the feet", "kg")
    r_u = vector("r_u", letters, "x of its CoM in P", "m")
    l_u = vector("l_u", letters, "z of its CoM in P", "m")
    m = vector("m", letters, "masses of the segments, from the ankle up", "kg")
    x = matrix("x", letters, letters, "x of the joint of segment v in configuration i, in P", "m")
    z = matrix("z", letters, letters, "z of the joint of segment v in configuration i, in P", "m")
    K: list[Expr] = []
    for i in range(n):
        foot = m_u.symbols[0] * (l_u.symbols[i] + sp.I * r_u.symbols[i])
        at = [z.symbols[i * n + v] + sp.I * x.symbols[i * n + v] for v in range(n)]
        total = m_2.symbols[i] * (Z.symbols[i] + sp.I * X.symbols[i])
        masses, origins = (np.array(values, dtype=object) for values in (m.symbols, at))
        K.append(moment_of_coms(total, foot, masses, origins))
    inputs = (X, Z, phi, m_2, m, m_u, r_u, l_u, x, z)
    zero = (sp.Integer(0),) * n
    return System(letters, letters, angles, tuple(K), zero, m.symbols, m_2.symbols, inputs)
