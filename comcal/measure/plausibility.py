# SPDX-License-Identifier: Apache-2.0
"""Can these numbers be true? Wrong units, signs and sides are recognised and proposals made.

Nothing is ever corrected silently: a wrong guess would be a wrong robot.
"""

from __future__ import annotations

from collections.abc import Iterator

from comcal.errors import DataError
from comcal.measure.plausible_loads import check_loads
from comcal.measure.plausible_numbers import check_lengths, check_positions, check_stillness
from comcal.measure.table import PoseTable
from comcal.robot.model import Robot


def implausibilities(table: PoseTable, robot: Robot) -> Iterator[DataError]:
    """Yield everything that cannot be true about a table, likely causes first.

    Parameters
    ----------
    table : PoseTable
    robot : Robot

    Yields
    ------
    DataError
        ``UnitsError`` (degrees, millimetres, g, kgf), ``NotStillError``, ``SignError`` (sense of a
        wrench, left and right exchanged), ``NotBalancedError`` (weight, lean, centre of pressure).
        What is wrong after a wrong unit or sign may be a consequence of it.
    """
    yield from check_positions(table, robot)
    yield from check_lengths(table, robot)
    yield from check_stillness(table, robot)
    yield from check_loads(table, robot)


def check_plausible(table: PoseTable, robot: Robot) -> None:
    """Raise the first thing that cannot be true about a table.

    Parameters
    ----------
    table : PoseTable
    robot : Robot

    Raises
    ------
    DataError
        See :func:`implausibilities`.
    """
    for error in implausibilities(table, robot):
        raise error
