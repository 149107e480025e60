# SPDX-License-Identifier: Apache-2.0
"""The text about the nearest physically possible robot."""

from __future__ import annotations

import numpy as np
from rich.console import Console

from comcal.identify.consistent import BOUND, ConsistentFit, ConsistentLink
from comcal.identify.prior import CONTRADICTS, MEASURED
from comcal.report.console import print_lines, print_table

MOVED = 5e-5
"""Components that move by less leave a link out of the table [m]: half its last digit."""


def print_consistent(console: Console, consistent: ConsistentFit) -> None:
    """Print which bounds hold the answer, what they cost, and the links that they move.

    Parameters
    ----------
    console : Console
    consistent : ConsistentFit
    """
    console.print()
    heading = "Nearest robot with positive masses and every CoM inside its link"
    print_lines(console, [heading], style="bold")
    if consistent.theta is None:
        print_lines(console, ["there is none: these bounds contradict one another"], style="bold")
        print_lines(console, (f"  {bound.words}" for bound in consistent.contradiction))
        line = "correct the URDF, its collision geometry, or what robot.yaml gives"
        print_lines(console, [line])
    else:
        _answer(console, consistent)
    _without(console, consistent)


def _answer(console: Console, consistent: ConsistentFit) -> None:
    moved = [link for link in consistent.links if _has_moved(link)]
    if not consistent.active:
        print_lines(console, ["no bound is in the way: the fit is physically possible as it is"])
    else:
        print_lines(console, (f"  {active.bound.words}" for active in consistent.active))
        cost = (
            f"cost: chi2 + {consistent.chi2_increase:.1f} in {consistent.dof} direction(s), "
            f"p = {consistent.p:.2g}"
        )
        if consistent.contradicted:
            hardest = consistent.active[0].bound.words
            line = (
                f"{cost}, limit {CONTRADICTS:g}: the data CONTRADICT this bound: {hardest}; check "
                "the collision geometry, and what the link carries outside it"
            )
            print_lines(console, [line], style="bold")
        else:
            print_lines(console, [f"{cost}: within the noise"])
    if moved:
        rows = [
            (link.link, f"{link.mass:.3f}", *(_component(link, i) for i in range(3)))
            for link in moved
        ]
        print_table(console, rows, ("link", "mass kg", "x mm", "y mm", "z mm"))
        line = (
            "before the arrow: without bounds; (... prior): not determined by these poses; none of "
            "this table is exported"
        )
        print_lines(console, [line])


def _has_moved(link: ConsistentLink) -> bool:
    if BOUND in (*link.source, link.mass_source):
        return True
    return bool(np.nanmax(np.abs(np.nan_to_num(link.com - link.before))) > MOVED)


def _component(link: ConsistentLink, i: int) -> str:
    com, before, source = link.com[i], link.before[i], link.source[i]
    text = f"{com * 1e3:.1f}"
    if not abs(com - before) <= MOVED:
        text = f"{before * 1e3:.1f} -> {text}"
    return text if source == MEASURED else f"({text} {source})"


def _without(console: Console, consistent: ConsistentFit) -> None:
    """Say once for each reason whose CoM is not bounded."""
    by_reason: dict[str, list[str]] = {}
    for link, why in consistent.without:
        by_reason.setdefault(why, []).append(link)
    print_lines(
        console, (f"not bounded: {', '.join(links)}: {why}" for why, links in by_reason.items())
    )
