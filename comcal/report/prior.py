# SPDX-License-Identifier: Apache-2.0
"""The text about data and CAD together: every number that is CAD's says so."""

from __future__ import annotations

from rich.console import Console

from comcal.identify.prior import CONTRADICTS, MARKED_SHARE, PRIOR, PriorFit, PriorLink
from comcal.report.console import print_lines, print_table
from comcal.report.numbers import plus_minus

MOST_NAMED = 3
"""Unknowns named when data and prior contradict one another."""


def print_prior(console: Console, prior: PriorFit) -> None:
    """Print every link as data and prior have it, and whether the two go together.

    Parameters
    ----------
    console : Console
    prior : PriorFit
    """
    console.print()
    heading = f"Data and CAD together: tolerances of robot.yaml at strength {prior.strength:g}"
    print_lines(console, [heading], style="bold")
    free = prior.fit.unknowns.free_masses
    fitted = [link for link in prior.links if _is_fitted(link)]
    rows = [(link.link, *([_mass(link)] if free else []), *_components(link)) for link in fitted]
    print_table(console, rows, ("link", *(["mass kg"] if free else []), *_AXES))
    lines = [
        f"(... prior): more than {MARKED_SHARE:.0%} of what is known about it is from CAD, not "
        "measured; none of this table is exported"
    ]
    kept = [link.link for link in prior.links if link.mass and not _is_fitted(link)]
    if kept:
        lines.append(f"entirely prior: {', '.join(kept)}")
    print_lines(console, lines)
    print_lines(console, [_agreement(prior)], style="bold" if prior.contradict else "")


_AXES = ("x mm", "y mm", "z mm")


def _is_fitted(link: PriorLink) -> bool:
    """Return whether the poses say anything about a link, or nonsense (a negative mass)."""
    return link.mass_share < 1.0 or bool((link.share < 1.0).any())


def _mass(link: PriorLink) -> str:
    text = plus_minus(link.mass, link.mass_sigma)
    return f"({text} prior)" if link.mass_source == PRIOR else text


def _components(link: PriorLink) -> list[str]:
    texts = [plus_minus(c, s, 1e3) for c, s in zip(link.com, link.sigma, strict=True)]
    return [
        f"({text} prior)" if source == PRIOR else text
        for text, source in zip(texts, link.source, strict=True)
    ]


def _agreement(prior: PriorFit) -> str:
    numbers = (
        f"chi2 of the step between them {prior.chi2:.1f} for {prior.dof} directions that the poses "
        f"determine, p = {prior.p:.2g}"
    )
    if not prior.contradict:
        return f"data and prior agree: {numbers}"
    named = ", ".join(f"{name} ({pull:+.1f} sigma)" for name, pull in prior.far[:MOST_NAMED])
    return (
        f"data and prior CONTRADICT one another: {numbers}, limit {CONTRADICTS:g}"
        + (f"; farthest from CAD: {named}" if named else "")
        + f"; this robot is not as close to its URDF as tolerances say: --prior "
        f"{prior.agreeing_strength:.1g} would agree, or look for the link that is wrong"
    )
