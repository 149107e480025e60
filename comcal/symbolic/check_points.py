# SPDX-License-Identifier: Apache-2.0
"""Random points at which a formula is compared with the truth: robots, poses and their loads.

Every point is a robot drawn at random (CoMs off the links' lines, no angle near zero) with all
its symbols, known and unknown, agreeing with each other as the moment balance makes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt

from comcal.robot.tree import Array
from comcal.statics.planar import ComplexArray


class Kind(Enum):
    """What a symbol measures; only symbols of one kind are taken for each other."""

    MASS = "mass"
    LENGTH = "length"
    ANGLE = "angle"
    SLOPE = "slope"
    FORCE = "force"
    MOMENT = "moment"
    FIRST_MOMENT = "first moment"
    DETERMINANT = "determinant"


@dataclass(frozen=True)
class Points:
    """Values of all symbols of a model.

    Parameters
    ----------
    values : mapping of str to array, shape (count,)
        SI and radians.
    kinds : mapping of str to Kind
    derived : frozenset of str
        Symbols computed from the others, not drawn.
    """

    values: Mapping[str, Array]
    kinds: Mapping[str, Kind]
    derived: frozenset[str] = frozenset()

    def only(self, choice: slice | npt.NDArray[np.bool_]) -> Points:
        """Return some of the points.

        Parameters
        ----------
        choice : slice, or array of bool, shape (count,)
        """
        values = {name: value[choice] for name, value in self.values.items()}
        return Points(values, self.kinds, self.derived)


@dataclass
class Draw:
    """Draws values and keeps them under their names.

    Parameters
    ----------
    rng : numpy.random.Generator
    count : int
        Number of points.
    linked : bool
        Whether m_w is the sum of the masses above the ankles and m_2 that of all. Points at which
        they are not tell apart formulas that differ by this identity only.
    posture : callable
        Takes the angles drawn, returns those of the configuration.
    values : dict of str to array, shape (count,)
        What there is so far.
    kinds : dict of str to Kind
    drawn : set of str
        Names of values that were not computed from others.
    """

    rng: np.random.Generator
    count: int
    linked: bool
    posture: Callable[[Mapping[str, Array]], Mapping[str, Array]] = lambda angles: angles
    values: dict[str, Array] = field(default_factory=dict[str, Array])
    kinds: dict[str, Kind] = field(default_factory=dict[str, Kind])
    drawn: set[str] = field(default_factory=set[str])

    def put(self, kind: Kind, **values: Array) -> None:
        """Keep computed values."""
        self.values.update(values)
        self.kinds.update(dict.fromkeys(values, kind))
        self.drawn.difference_update(values)

    def draw(self, kind: Kind, low: float, high: float, *names: str) -> None:
        """Draw positive numbers.

        Parameters
        ----------
        kind : Kind
        low, high : float
            [SI].
        *names : str
        """
        for name in names:
            self.put(kind, **{name: self.rng.uniform(low, high, self.count)})
            self.drawn.add(name)

    def draw_signed(self, kind: Kind, low: float, high: float, *names: str) -> None:
        """Draw numbers of either sign.

        Parameters
        ----------
        kind : Kind
        low, high : float
            Of the absolute value [SI].
        *names : str
        """
        for name in names:
            sign = self.rng.choice((-1.0, 1.0), self.count)
            self.put(kind, **{name: sign * self.rng.uniform(low, high, self.count)})
            self.drawn.add(name)

    def masses(self, above: list[str]) -> None:
        """Draw the masses of the links and of the feet, and put m_w and m_2 beside them."""
        self.draw(Kind.MASS, 0.5, 5.0, *above, "m_u")
        if self.linked:
            m_w = sum((self.values[m] for m in above), np.zeros(self.count))
            self.put(Kind.MASS, m_w=m_w, m_2=m_w + self.values["m_u"])
        else:
            self.draw(Kind.MASS, 2.0, 9.0, "m_w", "m_2")

    def feet(self) -> None:
        """Draw the CoM of the feet and the height of the ankle axle."""
        self.draw_signed(Kind.LENGTH, 0.02, 0.1, "r_u")
        self.draw(Kind.LENGTH, 0.02, 0.2, "l_u", "U")

    def totals(self, pose: str, moment: ComplexArray) -> None:
        """Put r_w, l_w, X_2 and Z_2 of a pose, equations (16), (17), (23) and (26).

        Parameters
        ----------
        pose : str
            Letter at the end of the names.
        moment : complex array, shape (count,)
            First moment z + j x about P of what is above the ankles [kg m].
        """
        v = self.values
        x, z = moment.imag / v["m_w"], moment.real / v["m_w"]
        known_x, known_z = v["m_u"] * v["r_u"], v["m_u"] * v["l_u"]
        self.put(
            Kind.LENGTH,
            **{
                f"r_w{pose}": x,
                f"l_w{pose}": z - v["U"],
                f"X_2{pose}": (known_x + moment.imag) / v["m_2"],
                f"Z_2{pose}": (known_z + moment.real) / v["m_2"],
            },
        )

    def alias(self, **names: str) -> None:
        """Give a symbol a second name."""
        for new, old in names.items():
            self.put(self.kinds[old], **{new: self.values[old]})
            self.drawn.update({new} if old in self.drawn else ())

    def points(self) -> Points:
        """Return what was drawn."""
        return Points(self.values, self.kinds, frozenset(self.values) - self.drawn)
