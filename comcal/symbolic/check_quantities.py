# SPDX-License-Identifier: Apache-2.0
"""Which quantities a hand-written formula can be checked against.

Equation numbers are those of Muscolo et al. (2017). Each value comes from the moment balance in
complex numbers, never from a printed formula.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.check_models import (
    chain_points,
    cramer_points,
    paper_matrix,
    paper_points,
    two_feet_points,
    two_pose_points,
)
from comcal.symbolic.check_points import Draw, Points

Values = Mapping[str, Array]


@dataclass(frozen=True)
class Quantity:
    """Something that a formula may claim to be.

    Parameters
    ----------
    name, meaning, unit : str
    equation : str
        Number in the paper; empty if it has none.
    model : callable
        Draws the points.
    value : callable
        Takes the values of all symbols, returns shape (count,), or (rows, columns, count).
    about : tuple of str
        Symbols that a formula for the value may not contain, because they are what it says.
    shape : tuple of int or None
        Rows and columns if it is a matrix.
    column : int or None
        Which column of A the right-hand side replaces, for a solution by Cramer's rule.
    any_links : bool
        Whether the number of links and the configuration can be chosen.
    """

    name: str
    meaning: str
    unit: str
    equation: str
    model: Callable[[Draw, int], None]
    value: Callable[[Values], Array]
    about: tuple[str, ...]
    shape: tuple[int, int] | None = None
    column: int | None = None
    any_links: bool = False

    def points(self, draw: Draw, links: int) -> Points:
        """Draw points for a chain of so many links."""
        self.model(draw, links)
        return draw.points()


def numerator(v: Values, column: int) -> Array:
    """Return A with a column replaced by a_1 .. a_4, as in (40)-(43), shape (4, 4, count).

    Parameters
    ----------
    v : mapping of str to array, shape (count,)
    column : int
    """
    A = paper_matrix(v)
    A[:, column] = np.stack([v[f"a_{i}"] for i in range(1, 5)])
    return A


def _moment(pose: str, axis: str) -> Callable[[Values], Array]:
    if axis == "x":
        return lambda v: v["m_w"] * v[f"r_w{pose}"]
    return lambda v: v["m_w"] * (v[f"l_w{pose}"] + v["U"])


def _symbol(name: str) -> Callable[[Values], Array]:
    return lambda v: v[name]


def _right_side(v: Values) -> Array:
    return np.stack([v[f"a_{i}"] for i in range(1, 5)])[:, None]


def _moments(pose: str, equations: tuple[str, str], *, any_links: bool) -> list[Quantity]:
    model = chain_points if any_links else paper_points
    where = f" in pose {pose}" if pose else ""
    return [
        Quantity(
            name=f"moment_{axis}" + (f"_{pose}" if pose else ""),
            meaning=f"first moment about P along {axis} of what is above the ankles{where}",
            unit="kg m",
            equation=equation,
            model=model,
            value=_moment(pose, axis),
            about=(f"{'r' if axis == 'x' else 'l'}_w{pose}", f"{axis.upper()}_2{pose}"),
            any_links=any_links,
        )
        for axis, equation in zip("xz", equations, strict=True)
    ]


def _all() -> list[Quantity]:
    found = [
        *_moments("b", ("(34)", "(35)"), any_links=False),
        *_moments("c", ("(36)", "(37)"), any_links=False),
        *_moments("", ("", ""), any_links=True),
        Quantity(
            "link_com_matrix",
            "matrix of the balance of b and c for r_b, l_b, r_c, l_c",
            "kg",
            "(38)",
            paper_points,
            paper_matrix,
            (),
            shape=(4, 4),
        ),
        Quantity(
            "link_com_rhs",
            "right-hand side of the balance of b and c",
            "kg m",
            "(39)",
            cramer_points,
            _right_side,
            ("a_1", "a_2", "a_3", "a_4"),
            shape=(4, 1),
        ),
        Quantity(
            "det_A",
            "determinant of the matrix (38)",
            "kg^4",
            "(38)",
            cramer_points,
            _symbol("det_A"),
            ("det_A",),
        ),
    ]
    for column, name in enumerate(("r_b", "l_b", "r_c", "l_c")):
        meaning = f"{name} by Cramer's rule"
        equation = f"({40 + column})"
        found.append(
            Quantity(
                name,
                meaning,
                "m",
                equation,
                cramer_points,
                _symbol(name),
                (name,),
                shape=(4, 4),
                column=column,
            )
        )
    for number, name in enumerate(("alpha", "beta", "gamma", "delta"), 10):
        unit = "m" if name in {"alpha", "gamma"} else "1"
        meaning = f"{name} of the line of action of gravity"
        about = (name, "X_2" if number < 12 else "Y_2")
        found.append(
            Quantity(name, meaning, unit, f"({number})", two_feet_points, _symbol(name), about)
        )
    for name, equation in (
        ("Z_2B", "(19)"),
        ("Z_2A", "(20)"),
        ("X_2B", "(16)"),
        ("r_w", ""),
        ("l_w", ""),
    ):
        meaning = f"{name} from a pose A and its tilted twin B"
        found.append(
            Quantity(name, meaning, "m", equation, two_pose_points, _symbol(name), (name,))
        )
    return found


QUANTITIES: Final[Mapping[str, Quantity]] = {q.name: q for q in _all()}
"""Every quantity by its name."""
