# SPDX-License-Identifier: Apache-2.0
"""What ``comcal compare`` says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from comcal.identify.differences import ONE_IN, SIGMAS, Change, limit_for, strongest_first
from comcal.report.console import PLUS_MINUS, print_lines, print_table

FORMAT = "comcal-comparison/1"
_UNIT = {"kg": (1.0, "kg"), "m": (1e3, "mm"), "kg m": (1e3, "kg mm")}


@dataclass(frozen=True)
class Comparison:
    """Two calibrations side by side.

    Parameters
    ----------
    a, b : str
        What was compared: before and after.
    changes : tuple of Change
        Every number that both determine, changed or not.
    posture : str
        In which the total CoM is compared; empty where it is not.
    """

    a: str
    b: str
    changes: tuple[Change, ...]
    posture: str
    notes: tuple[str, ...]

    @property
    def limit(self) -> float:
        """How many sigmas one of these numbers must change by to count as changed."""
        return limit_for(len(self.changes))

    @property
    def changed(self) -> tuple[Change, ...]:
        """What counts as changed, strongest first."""
        return tuple(c for c in strongest_first(self.changes) if c.in_sigmas > self.limit)


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """Return a comparison as JSON-able data, SI.

    Parameters
    ----------
    comparison : Comparison
    """
    changed = comparison.changed
    return {
        "format": FORMAT,
        "a": comparison.a,
        "b": comparison.b,
        "verdict": "changed" if changed else "no_change",
        "limit_sigmas": comparison.limit,
        "posture": comparison.posture or None,
        "changes": [
            {
                "name": c.name,
                "kind": c.kind,
                "unit": c.unit,
                "a": c.a,
                "b": c.b,
                "change": c.value,
                "sigma": c.sigma,
                "sigmas": c.in_sigmas if np.isfinite(c.in_sigmas) else None,
                "beyond_2_sigma": bool(c.in_sigmas > SIGMAS),
                "changed": c in changed,
            }
            for c in comparison.changes
        ],
        "notes": list(comparison.notes),
    }


def print_comparison(console: Console, comparison: Comparison) -> None:
    """Print what is beyond two sigma, mass and total CoM in any case, and the verdict.

    Parameters
    ----------
    console : Console
    comparison : Comparison
    """
    changed = comparison.changed
    print_lines(console, (f"note: {note}" for note in comparison.notes))
    print_lines(console, [f"From {comparison.a} to {comparison.b}"], style="bold")
    beyond = [c for c in strongest_first(comparison.changes) if c.in_sigmas > SIGMAS]
    always = [c for c in comparison.changes if c.kind in ("mass", "total_com") and c not in beyond]
    rows = [
        (
            c.name,
            _number(c, c.a),
            _number(c, c.b),
            f"{_number(c, c.value)}{PLUS_MINUS}{_number(c, c.sigma)}",
            _UNIT[c.unit][1],
            f"{c.in_sigmas:.1f}",
            "changed" if c in changed else "beyond 2 sigma" if c in beyond else "",
        )
        for c in [*beyond, *always]
    ]
    header = ("", "before", "after", "change", "unit", "sigmas", "")
    print_table(console, rows, header)
    if comparison.posture:
        print_lines(console, [f"total CoM in P, posture: {comparison.posture}"])
    count = len(comparison.changes)
    console.print()
    largest = strongest_first(comparison.changes)[0]
    lines = [
        f"{len(beyond)} of {count} numbers are beyond 2 sigma; by chance {count * ONE_IN:.1f} "
        f"would be. One of {count} counts as changed beyond {comparison.limit:.1f} sigma",
    ]
    print_lines(console, lines)
    verdict = (
        f"CHANGED: {', '.join(c.name for c in changed[:5])}"
        + (f" and {len(changed) - 5} more" if len(changed) > 5 else "")
        if changed
        else f"NO CHANGE: the largest is {largest.name}, {largest.in_sigmas:.1f} sigma"
    )
    print_lines(console, [f"Verdict: {verdict}"], style="bold")


def _number(change: Change, value: float) -> str:
    """Return a number of *change* with as many decimals as two digits of its sigma need."""
    factor, _ = _UNIT[change.unit]
    sigma = change.sigma * factor
    decimals = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 4)) if sigma > 0.0 else 4
    return f"{round(value * factor, decimals) + 0.0:.{decimals}f}"
