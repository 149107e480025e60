# SPDX-License-Identifier: Apache-2.0
"""Where the links of a spatial chain are, as steps: every sine, rotation and origin has a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from comcal.symbolic.algebra import Expr, Matrix, sp
from comcal.symbolic.program import Steps, folded
from comcal.symbolic.spatial import SpatialChain, place

AXIS_NAMES = ("x", "y", "z")
TURNS = (sp.cos, sp.sin)


def named_places(
    chain: SpatialChain, positions: Sequence[Expr], steps: Steps, name: str = ""
) -> list[tuple[Matrix, Matrix]]:
    """Return axes and origin of the base and of every link, in the base frame.

    Parameters
    ----------
    chain : SpatialChain
    positions : sequence of sympy.Expr
        Of its joints [rad] or [m].
    steps : Steps
        The steps are added to it.
    name : str
        Of the configuration, for the names of the steps.
    """
    mark = f"{name}_" if name else ""
    placed: list[tuple[Matrix, Matrix]] = [(sp.eye(3), sp.zeros(3, 1))]
    for k, (joint, symbol, q) in enumerate(zip(chain.joints, chain.q, positions, strict=True), 1):
        named = {symbol: folded(q)}
        if not joint.prismatic:
            named = {f(symbol): steps.let(f"{f}_{mark}{k}", f(q), real=True) for f in TURNS}
        alone = replace(chain, joints=(joint,), q=(symbol,))
        R_own, p_own = (part.xreplace(named) for part in place(alone)[1])
        R, p = placed[-1]
        R_k, p_k = R * R_own, p + R * p_own
        for i, a in enumerate(AXIS_NAMES):
            p_k[i] = steps.let(f"p_{mark}{k}_{a}", p_k[i], real=True)
            for j, b in enumerate(AXIS_NAMES):
                R_k[i, j] = steps.let(f"R_{mark}{k}_{a}{b}", R_k[i, j], real=True)
        placed.append((R_k, p_k))
    return placed
