# SPDX-License-Identifier: Apache-2.0
"""Numbers with a unit, as people write them: ``26.32 mm``, ``5 deg``, ``3 N cm``, ``20 mA``.

Inside comcal everything is SI and radians; another unit exists only in a file that names it.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal
from difflib import get_close_matches
from enum import Enum

from comcal.errors import ConfigError

LARGEST = 1e9
"""No length, mass, force ... of a robot is larger than this in SI; beyond it sums overflow."""

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
"""A decimal number as YAML, CSV and URDF write it; Python's ``1_000`` and ``nan`` are not."""

_DEG = math.pi / 180.0
_STANDARD_GRAVITY = 9.80665


class Dimension(Enum):
    """What a number measures; the value names it in messages."""

    LENGTH = "length"
    MASS = "mass"
    ANGLE = "angle"
    FORCE = "force"
    MOMENT = "moment"
    CURRENT = "current"
    ACCELERATION = "acceleration"
    TORQUE_CONSTANT = "torque constant"
    STIFFNESS = "rotational stiffness"
    COMPLIANCE = "rotational compliance"
    TIME = "time"
    RATIO = "ratio"


UNITS: dict[Dimension, dict[str, float]] = {
    Dimension.LENGTH: {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    Dimension.MASS: {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    Dimension.ANGLE: {"rad": 1.0, "mrad": 1e-3, "deg": _DEG, "°": _DEG, "arcmin": _DEG / 60.0},
    Dimension.FORCE: {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": _STANDARD_GRAVITY},
    Dimension.MOMENT: {"N m": 1.0, "N cm": 1e-2, "N mm": 1e-3, "mN m": 1e-3},
    Dimension.CURRENT: {"A": 1.0, "mA": 1e-3},
    Dimension.ACCELERATION: {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": _STANDARD_GRAVITY},
    Dimension.TORQUE_CONSTANT: {"N m/A": 1.0, "mN m/A": 1e-3, "N cm/A": 1e-2},
    Dimension.STIFFNESS: {"N m/rad": 1.0, "N m/deg": 1.0 / _DEG},
    Dimension.COMPLIANCE: {"rad/(N m)": 1.0, "deg/(N m)": _DEG},
    Dimension.TIME: {"s": 1.0, "ms": 1e-3, "min": 60.0},
    Dimension.RATIO: {"1": 1.0, "%": 1e-2},
}
"""Factor to SI of every unit, by dimension; the SI unit comes first."""


def parse_quantity(value: object, dimension: Dimension) -> float:
    """Convert a number, or a text of a number and a unit, to SI.

    Parameters
    ----------
    value : object
        A number is taken as SI; a text may carry a unit: ``"26.32 mm"``, ``"3 N cm"``.
    dimension : Dimension
        What the number must measure.

    Returns
    -------
    float
        In the SI unit of *dimension* (the first of ``UNITS[dimension]``); angles in rad.

    Raises
    ------
    ConfigError
        If it is not a finite number of a believable size, or the unit is not one of *dimension*.

    Examples
    --------
    >>> parse_quantity("26.32 mm", Dimension.LENGTH)
    0.02632
    >>> parse_quantity("3 N cm", Dimension.MOMENT)
    0.03
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ConfigError(
            f"a {dimension.value} must be a number or a text such as {_example(dimension)!r}",
            measured=f"got {_shortened(value)}",
        )
    quantity = _converted(value.strip(), dimension) if isinstance(value, str) else _as_float(value)
    if not abs(quantity) <= LARGEST:
        raise ConfigError(
            f"a {dimension.value} must be finite and of a believable size",
            measured=f"{_shortened(value)}",
            limit=f"{LARGEST:g} {next(iter(UNITS[dimension]))}",
        )
    return quantity


def _converted(text: str, dimension: Dimension) -> float:
    """Return what ``"3 N cm"`` is in SI, rounded once: 26.32 mm is the float 0.02632."""
    match = NUMBER.match(text)
    if match is None:
        raise ConfigError(
            f"{_shortened(text)} is not a {dimension.value}",
            next_step=f"write a number, or a number with a unit such as {_example(dimension)!r}",
        )
    number, unit = match.group(), text[match.end() :].strip()
    if not unit or math.isinf(float(number)):
        return float(number)
    factors = {_canonical(name): factor for name, factor in UNITS[dimension].items()}
    factor = factors.get(_canonical(unit))
    if factor is None:
        names = {name.lower(): name for name in UNITS[dimension]}
        close = get_close_matches(unit.lower(), names, n=1)
        if unit.startswith(","):
            raise ConfigError(
                f"{_shortened(text)} has a decimal comma", next_step="write a decimal point"
            )
        raise ConfigError(
            f"{_shortened(unit)} is not a unit of {dimension.value}",
            next_step=(f"did you mean {names[close[0]]!r}? " if close else "")
            + f"possible are {', '.join(UNITS[dimension])}",
        )
    return float(Decimal(number) * Decimal(repr(factor)))


def _canonical(unit: str) -> str:
    """Spell a unit in one way: ``N*m``, ``N·m``, ``Nm`` and ``N m`` are the same."""
    unit = unit.replace("²", "^2").replace("s2", "s^2").replace("µ", "u").replace("μ", "u")
    return re.sub(r"[\s*·]", "", unit)


def _as_float(value: int | float) -> float:
    """Return a float; integers too long for one become infinite and are refused as such."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _example(dimension: Dimension) -> str:
    """Return a text that would have worked."""
    return f"0.5 {next(iter(UNITS[dimension]))}" if dimension is not Dimension.RATIO else "0.5 %"


def _shortened(value: object) -> str:
    """Return *value* in quotes, cut where a message would become unreadable."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
