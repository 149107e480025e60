# SPDX-License-Identifier: Apache-2.0
"""What sensors that do not carry the robot say: mass below them, error on held-out poses."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console

from comcal.identify.cut_errors import MassBelow, masses_below
from comcal.identify.solution import Solution
from comcal.report.console import print_table
from comcal.report.numbers import plus_minus
from comcal.robot.tree import Array

HEADER = ("sensor", "kg below it", "kg (URDF)", "force x, y, z off N", "moment x, y, z off N m")


def print_other_cuts(console: Console, solution: Solution) -> None:
    """Print a table of the sensors besides those that carry; nothing where there are none.

    Parameters
    ----------
    console : Console
    solution : Solution
    """
    if not solution.held_out.cuts:
        return
    below = {found.sensor: found for found in masses_below(solution.adjustment)}
    rows = [
        (
            error.sensor,
            *_masses(below.get(error.sensor)),
            _three(error.force, 2),
            _three(error.moment, 3),
        )
        for error in solution.held_out.cuts
    ]
    console.print()
    print_table(console, rows, HEADER)


def other_cuts_json(solution: Solution) -> list[dict[str, Any]]:
    """Return the same as plain data: root mean squares by channel, in the sensor's frame.

    Parameters
    ----------
    solution : Solution
    """
    below = {found.sensor: found for found in masses_below(solution.adjustment)}
    found: list[dict[str, Any]] = []
    for error in solution.held_out.cuts:
        mass = below.get(error.sensor)
        is_known = mass is not None and np.isfinite(mass.mass)
        found.append(
            {
                "sensor": error.sensor,
                "poses": error.poses,
                "force_rms": [float(x) for x in error.force],
                "moment_rms": [float(x) for x in error.moment],
                "mass_below": mass.mass if mass is not None and is_known else None,
                "mass_below_sigma": mass.sigma if mass is not None and is_known else None,
            }
        )
    return found


def _masses(below: MassBelow | None) -> tuple[str, str]:
    if below is None:
        return "(URDF)", "-"
    if not np.isfinite(below.mass):
        return "not determined", f"{below.urdf:.3f}"
    return plus_minus(below.mass, below.sigma), f"{below.urdf:.3f}"


def _three(values: Array, decimals: int) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in values)
