# SPDX-License-Identifier: Apache-2.0
"""What ``comcal demo`` tells: what is off, why, what the extended model gains, the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from comcal.diagnose.diagnosis import Cause, Diagnosis, Verdict
from comcal.identify.calibration import Calibration
from comcal.report.console import print_lines, print_table
from comcal.report.demo_truth import Judgement
from comcal.report.diagnosis import print_diagnosis_verdict
from comcal.report.diagnosis_words import (
    HELD_OUT_HEADER,
    channel_rows,
    held_out_rows,
    in_favour,
    parameter_texts,
    rival_texts,
)
from comcal.report.display_units import shown_unit
from comcal.report.rerun import RerunGain, rerun_json

FORMAT = "comcal-demo/1"
CHANNELS_SHOWN, PARAMETERS_SHOWN = 3, 4
WELL_KNOWN = 0.01
"""One sigma of a link CoM that is worth comparing with a model [m]."""
MM = 1e3


@dataclass(frozen=True)
class DemoStory:
    """What a demo found out, before anybody looked at what was hidden.

    Parameters
    ----------
    diagnosis : Diagnosis
    held_out : tuple of int
        Ids of the poses that took no part in diagnosis and calibration.
    nominal, extended : Calibration or None
        With the model as it was given, and with the causes named; None: not possible, or nothing
        was named.
    rerun : RerunGain or None
        The physics again at the poses held out; None likewise.
    page : Path
        ``report.html`` of the diagnosis.
    notes : tuple of str
        Why something is missing.
    """

    diagnosis: Diagnosis
    held_out: tuple[int, ...]
    nominal: Calibration | None
    extended: Calibration | None
    rerun: RerunGain | None
    page: Path
    notes: tuple[str, ...] = ()


def print_demo(console: Console, story: DemoStory) -> None:
    """Print what a demo found out, its verdict last.

    Parameters
    ----------
    console : Console
    story : DemoStory
    """
    diagnosis = story.diagnosis
    console.print()
    print_lines(console, [diagnosis.sentence], style="bold")
    _residuals(console, diagnosis)
    _causes(console, diagnosis)
    _gain(console, story)
    _calibrations(console, story)
    print_lines(console, (f"note: {note}" for note in story.notes))
    console.print()
    print_diagnosis_verdict(console, diagnosis)


def demo_json(story: DemoStory, judgement: Judgement) -> dict[str, Any]:
    """Return a demo as JSON-able data, SI; the diagnosis has a file of its own.

    Parameters
    ----------
    story : DemoStory
    judgement : Judgement
    """
    calibrations = {"nominal": story.nominal, "extended": story.extended}
    return {
        "verdict": story.diagnosis.verdict.value,
        "found": [cause.name for cause in story.diagnosis.causes],
        "hidden": [
            {"effect": c.effect, "target": c.target, "parameters": dict(c.parameters)}
            for c in judgement.hidden
        ],
        "right": judgement.is_right,
        "values": judgement.values,
        "values_inside": judgement.inside,
        "held_out_poses": list(story.held_out),
        "calibration": {
            name: None if c is None else {"verdict": c.verdict.value, **_checks(c)}
            for name, c in calibrations.items()
        },
        "rerun": None if story.rerun is None else rerun_json(story.rerun),
        "notes": list(story.notes),
    }


def _checks(calibration: Calibration) -> dict[str, Any]:
    """Return what was measured against limits, NaN as null."""
    return {
        check.name: check.measured if np.isfinite(check.measured) else None
        for check in calibration.checks
    }


def _residuals(console: Console, diagnosis: Diagnosis) -> None:
    channels, rest = diagnosis.channels[:CHANNELS_SHOWN], diagnosis.channels[CHANNELS_SHOWN:]
    rows = [row[:-1] for row in channel_rows(channels)]
    if rest:
        before, after = (max(getattr(c, f"sigmas_{when}") for c in rest) for when in _WHEN)
        rows.append((f"{len(rest)} more", "", f"<= {before:.1f} -> {after:.1f}", ""))
    print_table(console, rows, ("residual, rms", "given -> extended", "sigmas", "follows"))


_WHEN = ("before", "after")


def _causes(console: Console, diagnosis: Diagnosis) -> None:
    for cause in diagnosis.causes:
        console.print()
        partial = " (PARTIAL: more is wrong)" if diagnosis.verdict is Verdict.UNEXPLAINED else ""
        title = f"{cause.name}, true minus assumed, 95 % intervals{partial}"
        print_lines(console, [title], style="bold")
        _cause(console, cause)


def _cause(console: Console, cause: Cause) -> None:
    every = parameter_texts(cause)
    shown = every
    if len(every) > PARAMETERS_SHOWN:
        shown = [p for p in every if p.note] or every[:PARAMETERS_SHOWN]
    if shown:
        print_table(console, [(f"  {p.key}", p.value, p.interval) for p in shown])
    lines = list[str]()
    if len(every) > len(shown):
        lines.append(f"  {len(every) - len(shown)} more, within what is healthy")
    against = ""
    if cause.rivals:
        name, chance, _ = rival_texts(cause.rivals[:1])[0]
        against = f"; strongest rival {name} {chance}"
    lines.append(f"  {cause.size:.0f} sigmas, {in_favour(cause.log_odds)} against none{against}")
    if cause.remedy:
        lines.append(f"  remedy: {cause.remedy}")
    print_lines(console, lines)


def _gain(console: Console, story: DemoStory) -> None:
    rows = held_out_rows(story.diagnosis)
    if rows and story.diagnosis.causes:
        console.print()
        print_lines(
            console,
            ["Predicted by statics, poses left out in turn (a gain alone proves no cause)"],
            style="bold",
        )
        print_table(console, rows, HELD_OUT_HEADER)
    if story.rerun is None:
        return
    rerun = story.rerun
    poses = ", ".join(map(str, rerun.poses))
    console.print()
    title = f"Physics run again by {rerun.engine} at poses that took no part ({poses})"
    print_lines(console, [title], style="bold")
    table = [(m.what, *_rerun_cells(m.unit, m.given, m.extended, m.noise)) for m in rerun.measures]
    print_table(console, table, ("root mean square", "nominal -> extended", "noise alone"))


def _rerun_cells(unit: str, given: float, extended: float, noise: float) -> tuple[str, str]:
    factor, shown = shown_unit(unit)
    a, b, c = (x * factor for x in (given, extended, noise))
    return f"{a:.3g} -> {b:.3g} {shown}", f"{c:.2g} {shown}"


def _calibrations(console: Console, story: DemoStory) -> None:
    """Print what a calibration of the CoMs says with the model as given and as extended."""
    both = {"nominal": story.nominal, "extended": story.extended}
    done = {name: calibration for name, calibration in both.items() if calibration is not None}
    if not done:
        return
    solved = tuple(done.values())
    rows = [
        ("mass, measured less model", *map(_mass, solved)),
        ("its own readings, chi2 / dof", *map(_misfit, solved)),
        ("link CoM furthest from it", *map(_furthest, solved)),
        (f"CoM of {len(story.held_out)} held-out poses, rms", *map(_held_out, solved)),
        ("limits of robot.yaml", *(c.verdict.value.replace("_", " ") for c in solved)),
    ]
    console.print()
    print_table(console, rows, ("Calibrated with the model", *done))


def _mass(calibration: Calibration) -> str:
    solution = calibration.solution
    if solution is None or not np.isfinite(solution.mass):
        return "-"
    extra = solution.mass - calibration.robot.tree.total_mass
    return f"{round(extra, 3) + 0.0:+.3f} +/- {solution.mass_sigma:.3f} kg"


def _misfit(calibration: Calibration) -> str:
    if calibration.solution is None:
        return "-"
    fit = calibration.solution.adjustment
    return f"{fit.chi2:.0f} / {fit.dof}"


def _furthest(calibration: Calibration) -> str:
    """Return which component of a link CoM, of those known well, is most sigmas off the model."""
    if calibration.solution is None:
        return "-"
    tree = calibration.robot.tree
    found: list[tuple[float, str]] = []
    for link in calibration.solution.links:
        off = link.com - tree.links[tree.link_index[link.link]].com
        sigma = np.sqrt(np.diag(link.cov))
        for k in range(3):
            if link.source[k] != "measured" or not 0.0 < sigma[k] < WELL_KNOWN:
                continue
            sigmas = abs(float(off[k] / sigma[k]))
            text = f"{link.link} {'xyz'[k]} {MM * off[k]:+.1f} mm, {sigmas:.1f} sigmas"
            found.append((sigmas, text))
    return max(found)[1] if found else "-"


def _held_out(calibration: Calibration) -> str:
    if calibration.solution is None:
        return "-"
    return f"{MM * calibration.solution.held_out.com_rms:.2f} mm"
