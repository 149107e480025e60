# SPDX-License-Identifier: Apache-2.0
r"""The closed form of a spatial chain when one joint is moved at a time, for any number of joints.

Let u_v be the first moment of all that joint v carries, about its origin, with all joints at zero.
Configuration 0 is that shape; in configuration v only joint v is moved, by q_v, and the first
moment of the robot, K = m com, changes by

.. math:: K_v - K_0 = (R(a_v, q_v) - 1)\,u_v \quad\text{(turning)}, \qquad
          K_v - K_0 = M_v\,a_v\,q_v \quad\text{(sliding)},

M_v being the mass that the joint carries. A turn leaves alone what lies along the axis, and in the
plane across it, with d_1, d_2 as real and imaginary axis, it is a complex factor: as in the planar
chain,

.. math:: S_v = \frac{(K_v - K_0)_\perp}{e^{j q_v} - 1}, \qquad
          \det = \prod_v 4 \sin^2(q_v / 2),

one 2 x 2 block per turning joint. A slide has no unknown. With the frames parallel at zero,
:math:`u_v = h_v + u_{v+1} + M_{v+1} p_{v+1}`; what of u_v the combinations s_v of
:mod:`comcal.symbolic.nullspace` do not hold is

.. math:: e_n = 0, \qquad e_v = e_{v+1} + D_{v+1} s_{v+1} + M_{v+1} p_{v+1}, \qquad
          s_v = D_v^T (u_v - e_v),

so that :math:`s_v = S_v - D_v^T e_v` from the tip to the base, where :math:`u_0 = K_0`. As these
equations have one solution for any K, they also prove that nothing else is in the null space.
"""

from __future__ import annotations

from dataclasses import dataclass

from comcal.symbolic.algebra import Expr, Matrix, sp
from comcal.symbolic.nullspace import across_of, mass_quantities, visible
from comcal.symbolic.one_joint import inverse_turn
from comcal.symbolic.program import Program, Quantity, Steps, matrix
from comcal.symbolic.spatial import SpatialChain
from comcal.symbolic.spatial_places import AXIS_NAMES
from comcal.symbolic.spatial_results import (
    combination_outputs,
    determinant_output,
    gain_output,
    misfit_output,
)
from comcal.symbolic.spatial_statements import one_joint_statements


@dataclass(frozen=True)
class OneJointShapes:
    """Inputs of the configurations that move one joint at a time.

    Parameters
    ----------
    q, com : Quantity
        Position of joint v in configuration v, shape (n,); total CoM, shape (n + 1, 3).
    """

    q: Quantity
    com: Quantity

    def com_of(self, i: int) -> Matrix:
        """Return the total CoM of configuration *i*."""
        return sp.Matrix(self.com.symbols[3 * i : 3 * i + 3])


def one_joint_shapes(chain: SpatialChain) -> OneJointShapes:
    """Return the configurations that move one joint of *chain* at a time."""
    n = len(chain.joints)
    names = [str(i) for i in range(n + 1)]
    joints = ", ".join(joint.name for joint in chain.joints)
    return OneJointShapes(
        q=Quantity(
            "q", chain.q, (n,), f"position of joint v in configuration v: {joints}", "rad|m"
        ),
        com=matrix(
            "com",
            names,
            AXIS_NAMES,
            f"total CoM of configurations 0 to {n}, in the frame of {chain.base}",
            "m",
        ),
    )


def spatial_one_joint_program(chain: SpatialChain) -> Program:
    """Return the identifiable combinations in closed form; its length grows with the joints only.

    Returns
    -------
    Program
        Outputs ``s`` [kg m]; ``c``, the CoM components that no other link shares [m]; ``misfit``
        of what was not used, along the axes [m]; ``gain`` [1], how much an error of K grows on its
        way to S_v, per turning joint; ``determinant`` [1].
    """
    found, shapes, steps = visible(chain), one_joint_shapes(chain), Steps()
    m_total = steps.let("m_total", sp.Add(*chain.m), real=True)
    s: dict[str, Expr] = {}
    gains: dict[str, Expr] = {}
    misfits: dict[str, Expr] = {}
    determinant = sp.Integer(1)
    e = sp.zeros(3, 1)
    for v in range(len(chain.joints), 0, -1):
        joint, q = chain.joints[v - 1], chain.q[v - 1]
        change = shapes.com_of(v) - shapes.com_of(0)
        beyond = sp.Add(*chain.m[v:])
        farther = sp.zeros(3, 1)
        along = -joint.axis.dot(change)
        if joint.prismatic:
            along += beyond / m_total * q
        else:
            half = steps.let(f"half_{v}", sp.sin(q / 2), real=True)
            turn = steps.let(f"turn_{v}", inverse_turn(q, half))
            own = across_of(found, v)
            real, imaginary = (c.direction.dot(change) for c in own)
            k = steps.let(f"k_{v}", m_total * (real + sp.I * imaginary))
            S = steps.let(f"S_{v}", k * turn)
            for c, part in zip(own, (sp.re(S), sp.im(S)), strict=True):
                s[c.label] = steps.let(c.label, part - c.direction.dot(e), real=True)
                farther += c.direction * s[c.label]
            gains[f"gain_{v}"] = 1 / (2 * sp.Abs(half))
            determinant = steps.let(f"det_{v}", determinant * 4 * half**2, real=True)
        misfits[f"misfit_{v}"] = along
        e += farther + beyond * joint.p
        for i, a in enumerate(AXIS_NAMES):
            e[i] = steps.let(f"e_{v - 1}_{a}", e[i], real=True)
    for c in across_of(found, 0):
        total = m_total * c.direction.dot(shapes.com_of(0))
        s[c.label] = steps.let(c.label, total - c.direction.dot(e), real=True)
    misfits, gains = (dict(reversed(x.items())) for x in (misfits, gains))
    outputs = [
        *combination_outputs(chain, found, [s[c.label] for c in found.combinations]),
        misfit_output(misfits, "configuration v along the axis of joint v"),
        gain_output(gains),
        determinant_output(determinant),
    ]
    return Program(
        name="first_moments",
        title=f"First moments of the chain {chain.base} to {chain.links[-1]}, one joint at a time",
        inputs=(shapes.com, shapes.q, *mass_quantities(chain)),
        steps=tuple(steps.done),
        outputs=tuple(o for o in outputs if o.values),
        statements=one_joint_statements(chain, found),
    ).only_used()
