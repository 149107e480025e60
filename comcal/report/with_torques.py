# SPDX-License-Identifier: Apache-2.0
"""A calibration with joint torques beside the same one without them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rich.console import Console

from comcal.identify.adjust import Adjustment
from comcal.identify.solution import Solution, sigmas
from comcal.report.console import print_lines, print_table


def print_with_and_without(console: Console, both: Solution, wrenches: Solution) -> None:
    """Print what torques add to foot wrenches.

    Parameters
    ----------
    console : Console
    both, wrenches : Solution
        From all readings, and from the foot wrenches alone.
    """
    console.print()
    print_lines(console, ["What joint torques add to the foot wrenches"], style="bold")
    quantities: list[tuple[str, Callable[[Solution], str]]] = [
        ("rank", lambda s: str(s.adjustment.rank)),
        ("condition", lambda s: f"{s.adjustment.condition:.0f}"),
        ("link CoMs: median sigma, mm", lambda s: f"{median_link_sigma(s) * 1e3:.3g}"),
        ("total CoM z: largest sigma, mm", lambda s: f"{largest_height_sigma(s) * 1e3:.3g}"),
        ("held-out CoM, mm rms", lambda s: f"{s.held_out.com_rms * 1e3:.3g}"),
        ("chi2 / degrees of freedom", lambda s: _per_dof(s.adjustment)),
    ]
    rows = [(name, of(wrenches), of(both)) for name, of in quantities]
    print_table(console, rows, ("", "wrenches alone", "with torques"))


def median_link_sigma(solution: Solution) -> float:
    """Return the median sigma of the link CoM components that are measured [m]; NaN without any."""
    found = [
        float(np.sqrt(link.cov[i, i]))
        for link in solution.links
        for i in range(3)
        if link.source[i] == "measured"
    ]
    return float(np.median(found)) if found else np.nan


def largest_height_sigma(solution: Solution) -> float:
    """Return the largest sigma of the total CoM's height over the poses [m]; NaN without any."""
    found = [float(sigmas(pose.cov)[2]) for pose in solution.poses]
    return max(found, default=np.nan)


def _per_dof(fit: Adjustment) -> str:
    return f"{fit.chi2:.0f} / {fit.dof}"
