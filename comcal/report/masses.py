# SPDX-License-Identifier: Apache-2.0
"""The text about refitted link masses: numbers where they mean something, reasons where not."""

from __future__ import annotations

import numpy as np

from comcal.identify.calibration import MISFIT
from comcal.identify.mass_refit import MassRefit
from comcal.identify.words import Combination

SMALL_RANGE = np.deg2rad(30.0)
"""Joints that move less are named when masses cannot be told apart [rad]; 30 deg is what bent
poses should have."""


def masses_lines(refit: MassRefit) -> list[str]:
    """Return the block on link masses.

    Parameters
    ----------
    refit : MassRefit

    Returns
    -------
    list of str
        Without line ends. A refused refit shows no mass of any link.
    """
    lines = ["Link masses, refitted with every CoM kept where the URDF has it"]
    if refit.masses is not None and refit.cov is not None:
        sigma = np.sqrt(np.diag(refit.cov))
        width = max(len(name) for name in refit.links)
        lines += [
            f"  {name:<{width}}  {mass:8.3f} +/- {s:.3f} kg   (URDF {urdf:.3f} kg)"
            for name, mass, s, urdf in zip(
                refit.links, refit.masses, sigma, refit.urdf, strict=True
            )
        ]
        lines.append(f"  {_quality(refit)}")
        return lines
    lines.append("  REFUSED: these data do not determine the mass of each link")
    lines += [f"  - {text}" for text in _objections(refit)]
    lines.append(f"  why: {_why(refit)}")
    lines.append("  determined, however the mass is split:")
    lines += [f"    {_combination(c)}" for c in refit.determined]
    if any(c.words != "mass" for c in refit.determined):
        lines.append("    (first moments in link frames; what hangs on a link counts at its joint)")
    if refit.determined_p < MISFIT:
        lines.append(
            f"    (these sigmas are too small: this fit misses the data as well, "
            f"p = {refit.determined_p:.1e})"
        )
    return lines


def _objections(refit: MassRefit) -> list[str]:
    """Return one line for each reason that concerns the whole fit, and one for each link."""
    by_link: dict[str, list[str]] = {}
    for objection in refit.objections:
        by_link.setdefault(objection.link, []).append(objection.words)
    whole = by_link.pop("", [])
    return [*whole, *(f"{link}: {'; '.join(words)}" for link, words in by_link.items())]


def _why(refit: MassRefit) -> str:
    small = [
        f"{name} moves only {np.rad2deg(span):.0f} deg"
        for name, span in refit.ranges.items()
        if name not in refit.slides and span < SMALL_RANGE
    ]
    return "; ".join([*small[:3], _quality(refit)])


def _quality(refit: MassRefit) -> str:
    condition = (
        f"condition {refit.condition:.0f}" if np.isfinite(refit.condition) else "rank deficient"
    )
    return (
        f"{condition}, rank {refit.rank} of {len(refit.links)}, chi2 {refit.chi2:.1f} for "
        f"{refit.dof} degrees of freedom"
    )


def _combination(c: Combination) -> str:
    if c.words == "mass":
        return f"{c.words}: {c.value:.3f} +/- {c.sigma:.3f} kg"
    return f"{c.words}: {1e3 * c.value:.1f} +/- {1e3 * c.sigma:.1f} kg mm"
