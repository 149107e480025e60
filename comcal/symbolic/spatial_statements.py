# SPDX-License-Identifier: Apache-2.0
"""What a derivation for a spatial chain says to its reader: axes, equations, singularities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from comcal.symbolic.algebra import sp
from comcal.symbolic.nullspace import Visible, across_of, visible_statements
from comcal.symbolic.program import Statement, real_symbols
from comcal.symbolic.spatial import SpatialChain, turning_positions
from comcal.symbolic.spatial_results import shown

if TYPE_CHECKING:
    from comcal.symbolic.spatial_system import Row, SpatialSystem


def joint_statements(chain: SpatialChain, found: Visible) -> tuple[Statement, ...]:
    """Return the axis of every joint and the two directions across it.

    Parameters
    ----------
    chain : SpatialChain
    found : Visible
    """
    statements: list[Statement] = []
    for v, joint in enumerate(chain.joints, start=1):
        axis = f"a_{v} = {shown(joint.axis)}"
        if joint.prismatic:
            words = f"Joint {v}, {joint.name}, slides along {axis} and carries {joint.link}."
        else:
            directions = (f"d{c.label[1:]} = {shown(c.direction)}" for c in across_of(found, v))
            words = (
                f"Joint {v}, {joint.name}, turns about {axis} and carries {joint.link}; across the "
                f"axis are {' and '.join(directions)}, the directions of "
                f"{' and '.join(c.label for c in across_of(found, v))}."
            )
        statements.append(Statement(words))
    return tuple(statements)


def one_joint_statements(chain: SpatialChain, found: Visible) -> tuple[Statement, ...]:
    """Return what is to be said about configurations that move one joint at a time.

    Parameters
    ----------
    chain : SpatialChain
    found : Visible
    """
    K, S, k, q, M, a, e, p = (sp.IndexedBase(name) for name in "KSkqMaep")
    d, s = (sp.IndexedBase(name) for name in "ds")
    v = sp.Symbol("v", integer=True)
    m_total, com = sp.Symbol("m_total"), sp.IndexedBase("com")
    statements = [
        *visible_statements(found),
        *joint_statements(chain, found),
        Statement(
            "In configuration 0 all joints are at zero; in configuration v only joint v is moved, "
            "to q_v. The first moment of the robot is",
            K[v],
            m_total * com[v],
        ),
        Statement(
            "A turn about a_v leaves alone what lies along a_v. Across it, with k_v = "
            "d_v1 . (K_v - K_0) + I d_v2 . (K_v - K_0), it is a complex factor on S_v, the first "
            "moment about joint v of all that it carries, joints at zero.",
            S[v],
            k[v] / (sp.exp(sp.I * q[v]) - 1),
        ),
    ]
    if any(joint.prismatic for joint in chain.joints):
        statements.append(
            Statement(
                "A slide has no unknown but the mass M_v it carries, which is taken as known; its "
                "configuration is a check, and may be left out (NaN).",
                K[v] - K[0],
                M[v] * a[v] * q[v],
            )
        )
    statements += [
        Statement(
            "s_v_i is the real (i = 1) or imaginary (i = 2) part of S_v less d_v_i . e_v, which "
            "the farther links bring. From the tip to the base, e_n = 0 and, with M_v the mass "
            "that joint v carries and p_v from joint v - 1 to joint v,",
            e[v - 1],
            e[v] + d[v, 1] * s[v, 1] + d[v, 2] * s[v, 2] + M[v] * p[v],
        ),
        Statement("For the base s_0 = K_0 - e_0; a slide has no s_v."),
        Statement(
            "The determinant of configuration 0 and of the equations across the axes: one 2 x 2 "
            "block per turning joint. Singular configurations: a joint is not turned, or by full "
            "turns; there are no others.",
            sp.Symbol("det"),
            sp.Mul(*(4 * sp.sin(x / 2) ** 2 for x in turning_positions(chain))),
        ),
        Statement(
            "Noise: an error of K_v or K_0 reaches S_v times gain_v, whatever the rest of the "
            "robot is like; least at half a turn.",
            sp.Symbol("gain_v"),
            1 / (2 * sp.Abs(sp.sin(q[v] / 2))),
        ),
    ]
    return tuple(statements)


def free_statements(system: SpatialSystem, solving: Sequence[Row]) -> tuple[Statement, ...]:
    """Return what is to be said about any configurations.

    Parameters
    ----------
    system : SpatialSystem
    solving : sequence of Row
        The equations that solve.
    """
    R, d, s, b, m, p, com = (sp.IndexedBase(name) for name in ("R", "d", "s", "b", "m", "p", "com"))
    i, k, n = (sp.Symbol(name, integer=True) for name in "ikn")
    first = system.shapes.names[0]
    chosen = "; ".join(dict.fromkeys(row.words for row in solving))
    return (
        *visible_statements(system.found),
        *joint_statements(system.chain, system.found),
        Statement(
            "The first moment of configuration i without the known lengths, p_k being the origin "
            "of link k.",
            b[i],
            sp.Symbol("m_total") * com[i] - sp.Sum(m[k] * p[k, i], (k, 1, n)),
        ),
        Statement(
            "R_k is the rotation of link k, d_k the directions of its combinations s_k. That of "
            f"the base is the same in all configurations: {first} gives s_0, the others the rest.",
            sp.Sum((R[k, i] - R[k, 0]) * d[k] * s[k], (k, 1, n)),
            b[i] - b[0],
        ),
        Statement(f"The equations that solve: {chosen}."),
        Statement(
            "Singular configurations: the determinant is zero, among others, when a joint that "
            "turns has the same angle in all configurations, as if it were fixed, and when two "
            "configurations differ in slides only."
        ),
        Statement(
            "Noise: an error of an equation reaches an unknown times their cofactor over the "
            "determinant. When one joint is turned at a time an error grows by "
            "1 / (2 sin(q_v / 2)) only, and the determinant is, up to its sign,",
            sp.Symbol("det"),
            sp.Mul(*(4 * sp.sin(x / 2) ** 2 for x in turning_positions(system.chain))),
        ),
    )


def sigma_statements(chain: SpatialChain, found: Visible) -> tuple[Statement, ...]:
    """Return the formulas by which to choose angles.

    Parameters
    ----------
    chain : SpatialChain
    found : Visible
    """
    f, sigma_com = sp.IndexedBase("f"), sp.IndexedBase("sigma_com")
    i, a, n = (sp.Symbol(name, integer=True) for name in "ian")
    sigma_s, sigma, q, m = real_symbols(["sigma_s", "sigma_com", "q_v", "m_total"])
    return (
        *visible_statements(found),
        *joint_statements(chain, found),
        Statement(
            "Every s is linear in the CoMs, with factors f = ds/dcom for component a of "
            "configuration i; the components are taken as independent, masses and lengths as true.",
            sigma_s**2,
            sp.Sum(f[i, a] ** 2 * sigma_com[i, a] ** 2, (a, 1, 3), (i, 0, n)),
        ),
        Statement(
            "One joint turned by q_v: what its CoM adds to s_v_1 and s_v_2. Noise falls as the "
            "turn grows, up to half a turn.",
            sigma_s,
            m * sigma / (2 * sp.Abs(sp.sin(q / 2))),
        ),
    )
