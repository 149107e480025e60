# SPDX-License-Identifier: Apache-2.0
"""What a derivation for a spatial chain hands out, whichever configurations it is for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from comcal.symbolic.algebra import Expr
from comcal.symbolic.nullspace import Visible
from comcal.symbolic.program import Output
from comcal.symbolic.spatial import SpatialChain


def combination_outputs(
    chain: SpatialChain, found: Visible, values: Sequence[Expr]
) -> tuple[Output, Output]:
    """Return the identifiable combinations, and the CoM components among them.

    A combination in which only the link itself has a part is its mass times a component of its
    CoM: the plane across the last axis, and across every axis to which the next one is parallel.

    Parameters
    ----------
    chain : SpatialChain
    found : Visible
    values : sequence of sympy.Expr
        Of all combinations [kg m].
    """
    links = ", ".join(f"{c.label} of {c.link}" for c in found.combinations)
    components: dict[str, Expr] = {}
    whose: list[str] = []
    for c, value in zip(found.combinations, values, strict=True):
        if c.meaning.free_symbols <= set(found.h[c.k]) and chain.m[c.k] != 0:
            label = f"c{c.label[1:]}"
            components[label] = value / chain.m[c.k]
            whose.append(f"{label} of {c.link} along {shown(c.direction)}")
    return (
        Output(
            "s",
            tuple(c.label for c in found.combinations),
            tuple(values),
            True,
            f"identifiable combinations of first moments: {links}",
            "kg m",
        ),
        Output(
            "c",
            tuple(components),
            tuple(components.values()),
            True,
            "CoM components in which no other link has a part, from the link's joint: "
            + ", ".join(whose),
            "m",
        ),
    )


def misfit_output(values: Mapping[str, Expr], where: str) -> Output:
    """Return predicted minus given CoM of the equations that did not solve.

    Parameters
    ----------
    values : mapping
        By label [m].
    where : str
        Which equations these are.
    """
    meaning = f"predicted minus given CoM, where it was not needed to solve: {where}"
    return Output("misfit", tuple(values), tuple(values.values()), True, meaning, "m")


def gain_output(values: Mapping[str, Expr]) -> Output:
    """Return how much an error of a first moment grows on its way to the unknown.

    Parameters
    ----------
    values : mapping
        By label [1].
    """
    meaning = "per turning joint, how many times an error of K_v or K_0 reaches S_v"
    return Output("gain", tuple(values), tuple(values.values()), True, meaning, "1")


def determinant_output(value: Expr) -> Output:
    """Return the determinant of the equations that solve.

    Parameters
    ----------
    value : sympy.Expr
        [1]
    """
    meaning = "of the equations that solve: zero when a joint turns in no configuration"
    return Output("determinant", ("det",), (value,), False, meaning, "1")


def shown(vector: Expr) -> str:
    """Return a constant vector as text.

    Parameters
    ----------
    vector : sympy.Matrix, shape (3, 1)
    """
    return f"[{', '.join(f'{float(x):.4g}' for x in vector)}]"
