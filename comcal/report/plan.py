# SPDX-License-Identifier: Apache-2.0
"""What a person, or a program, reads after ``comcal plan``. Reads plain attributes only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from rich.console import Console

from comcal.plan.forecast import Forecast, LinkForecast
from comcal.plan.rules import EFFORT_SHARE
from comcal.plan.search import Found
from comcal.report.console import PLUS_MINUS, print_lines, print_table

MM = 1e3
AXES = "xyz"


class _Planned(Protocol):
    """The parts of :class:`comcal.workflow.plan.Planned` that are shown."""

    @property
    def seed(self) -> int: ...
    @property
    def found(self) -> Found: ...
    @property
    def forecast(self) -> Forecast: ...
    @property
    def before(self) -> Forecast | None: ...
    @property
    def longest_move(self) -> float: ...
    @property
    def collision_pairs(self) -> int: ...
    @property
    def unchecked(self) -> tuple[str, ...]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


def print_plan(
    console: Console, planned: _Planned, *, robot: str, goal: str, margin: float, joint_range: float
) -> None:
    """Print what a plan promises.

    Parameters
    ----------
    console : Console
    planned : Planned
    robot, goal : str
        Their names.
    margin : float
        Of the CoM inside the support polygon [m].
    joint_range : float
        Share of every joint's range that was used.
    """
    found, after, before = planned.found, planned.forecast, planned.before
    counts = Counter(found.poses.support)
    shares = ", ".join(f"{counts[s]} {s}" for s in dict.fromkeys(found.poses.support))
    new = "more " if before else ""
    print_lines(
        console,
        [f"{len(found.poses)} {new}poses for {robot}: {shares}; goal {goal}, seed {planned.seed}"],
        style="bold",
    )
    lines = [
        f"CoM at least {margin * MM:.0f} mm inside the soles, at most {EFFORT_SHARE:.0%} of every "
        f"motor's effort, {joint_range:.0%} of every joint's range, above the floor, "
        f"{planned.collision_pairs} pairs of solids kept apart; longest move of a "
        f"joint {planned.longest_move:.2f} rad (or m)",
        _quality(found, goal) if after.rank >= found.basis.shape[1] else _too_few(planned),
        *(f"note: {note}" for note in planned.notes),
    ]
    print_lines(console, [line for line in lines if line])
    console.print()
    title = "Predicted: CoM of each link in its URDF frame, one sigma (mm)"
    print_lines(console, [title], style="bold")
    rows = [
        (link.link, f"{link.mass:.3f}", *(_component(link, old, i) for i in range(3)))
        for link, old in zip(after.links, _old_links(after, before), strict=True)
    ]
    print_table(console, rows, ("link", "mass kg (URDF)", *AXES))
    line = (
        f"rank {_change(before and str(before.rank), str(after.rank))} of {after.unknowns} unknowns"
        f", condition {_change(before and f'{before.condition:.0f}', f'{after.condition:.0f}')}"
        f"; mass{PLUS_MINUS}{after.mass_sigma:.3g} kg"
    )
    print_lines(console, [line])
    if after.sums:
        console.print()
        print_lines(console, ["Only sums will be determined (first moments, kg mm)"], style="bold")
        print_table(
            console, [(c.words, f"{PLUS_MINUS.strip()} {c.sigma * MM:.3g}") for c in after.sums]
        )
    console.print()
    print_lines(
        console,
        [f"Predicted: total CoM in {len(found.held_out)} other balanced poses, one sigma (mm)"],
        style="bold",
    )
    label = "noise, with the new ones" if before else "noise of the poses"
    rows = [(label, *_triple(after.total_com))]
    if before:
        rows.insert(0, ("noise, recorded poses alone", *_triple(before.total_com)))
    rows.append(("CAD, where no pose sees it", *_triple(after.total_com_cad)))
    print_table(console, rows, ("from", *AXES))
    console.print()
    print_lines(console, (f"not checked: {note}" for note in planned.unchecked))


def _quality(found: Found, goal: str) -> str:
    chosen = f"chosen from {found.candidates} candidates"
    if np.isnan(found.efficiency):
        return chosen
    what = "the information per direction" if goal == "dopt" else "the precision of heights"
    return f"{chosen}; at least {found.efficiency:.0%} of {what} that any choice from them can give"


def _too_few(planned: _Planned) -> str:
    """Say that these poses leave out what others could show."""
    found = planned.found
    return (
        f"{planned.forecast.poses} poses determine {planned.forecast.rank} of the "
        f"{found.basis.shape[1]} combinations that these supports can show: plan more with -n"
    )


def _old_links(after: Forecast, before: Forecast | None) -> Sequence[LinkForecast | None]:
    return before.links if before else [None] * len(after.links)


def _component(link: LinkForecast, old: LinkForecast | None, i: int) -> str:
    def words(one: LinkForecast) -> str:
        if one.source[i] == "measured":
            return f"{one.sigma[i] * MM:.2f}"
        return "in a sum" if one.source[i] == "combination" else "unseen"

    return _change(words(old) if old else None, words(link))


def _change(before: str | None, after: str) -> str:
    return after if before is None or before == after else f"{before} -> {after}"


def _triple(values: np.ndarray) -> tuple[str, str, str]:
    x, y, z = (f"{v * MM:.2f}" for v in values)
    return x, y, z


def plan_json(planned: _Planned) -> dict[str, object]:
    """Return the same for programs: format ``comcal-plan/1``, SI units.

    Parameters
    ----------
    planned : Planned
    """
    found = planned.found
    counts = Counter(found.poses.support)
    return {
        "format": "comcal-plan/1",
        "seed": planned.seed,
        "poses": {s: counts[s] for s in dict.fromkeys(found.poses.support)},
        "candidates": found.candidates,
        "efficiency": _number(found.efficiency),
        "longest_move": planned.longest_move,
        "collision_pairs": planned.collision_pairs,
        "unchecked": list(planned.unchecked),
        "notes": list(planned.notes),
        "identifiable": found.basis.shape[1],
        "predicted": _forecast_json(planned.forecast),
        "before": _forecast_json(planned.before) if planned.before else None,
    }


def _forecast_json(forecast: Forecast) -> Mapping[str, object]:
    return {
        "poses": forecast.poses,
        "rank": forecast.rank,
        "unknowns": forecast.unknowns,
        "condition": forecast.condition,
        "mass_sigma": forecast.mass_sigma,
        "links": [
            {
                "link": link.link,
                "mass": link.mass,
                "sigma": [_number(s) for s in link.sigma],
                "source": list(link.source),
            }
            for link in forecast.links
        ],
        "combinations": [
            {"words": c.words, "coefficients": c.coefficients, "sigma": c.sigma}
            for c in forecast.sums
        ],
        "total_com_sigma": forecast.total_com.tolist(),
        "total_com_sigma_cad": forecast.total_com_cad.tolist(),
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
