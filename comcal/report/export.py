# SPDX-License-Identifier: Apache-2.0
"""What ``comcal export`` says about the model that it hands back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from comcal.identify.calibrated_model import CalibratedModel, ModelLink
from comcal.identify.calibration import MISFIT
from comcal.identify.model_error import ModelError
from comcal.identify.solution import MEASURED, PRIOR
from comcal.report.console import PLUS_MINUS, print_lines, print_table
from comcal.report.export_extension import part_lines
from comcal.report.json_numbers import number
from comcal.robot.findings import Finding

MM = 1e3
HARDLY = 0.005
"""Changes smaller than this are not shown [mm]."""


@dataclass(frozen=True)
class Summary:
    """What was exported.

    Parameters
    ----------
    document : mapping
        Format ``comcal-model/1``, as in the YAML file.
    verdict : str
        Of the result that was exported.
    diff : str
        From the session's URDF to the new one, unified.
    before, after : ModelError
        Of the session's URDF and of the new one, on the poses of the session.
    findings : tuple of Finding
        What is doubtful about the new URDF and was not about the old one.
    files : tuple of Path
        What was written.
    parts : tuple of (str, str)
        Changes of the model that the session was solved with, and where each belongs; empty where
        the URDF holds it.
    """

    model: CalibratedModel
    document: Mapping[str, Any]
    verdict: str
    diff: str
    before: ModelError
    after: ModelError
    findings: tuple[Finding, ...]
    files: tuple[Path, ...]
    parts: tuple[tuple[str, str], ...] = ()

    @property
    def reference(self) -> str:
        """What the fit started from."""
        return "the URDF with the model" if self.parts else "the URDF"


def exported_json(summary: Summary) -> dict[str, Any]:
    """Return an export as JSON-able data: the model, what it is worth, what was written.

    Parameters
    ----------
    summary : Summary
    """
    return {
        **summary.document,
        "session_poses": {
            "poses": len(summary.after.poses),
            "com_rms_mm": {
                "urdf": number(summary.before.com_rms * MM),
                "exported": number(summary.after.com_rms * MM),
            },
        },
        "notes": notes(summary),
        "diff": summary.diff,
        "files": [str(path) for path in summary.files],
    }


def print_exported(console: Console, summary: Summary) -> None:
    """Print every link's CoM before and after, where each number is from, and what is doubtful.

    Parameters
    ----------
    console : Console
    summary : Summary
    """
    model = summary.model
    print_lines(console, ["CoM of each link in its URDF frame, new (change), in mm"], style="bold")
    rows = [
        (link.link, f"{link.mass:.3f}", *(_component(link, i) for i in range(3)))
        for link in model.links
        if not link.kept
    ]
    print_table(console, rows, ("link", "mass kg", "x", "y", "z"))
    print_lines(
        console,
        [
            "no mark: measured by itself; s: a term of measured sums, shared out by the least "
            "change from the URDF; URDF: no pose speaks about it, so the number stays"
        ],
    )
    reasons: dict[str, list[str]] = {}
    for link in model.links:
        if link.kept:
            reasons.setdefault(link.kept, []).append(link.link)
    console.print()
    print_lines(console, (f"kept, {why}: {', '.join(names)}" for why, names in reasons.items()))
    print_lines(console, notes(summary))


def notes(summary: Summary) -> list[str]:
    """Return what should be known about the exported model, one sentence each.

    Parameters
    ----------
    summary : Summary
    """
    model, before, after = summary.model, summary.before, summary.after
    solution = model.solution
    urdf = solution.adjustment.unknowns.robot.tree.total_mass
    there = summary.reference
    measured = f"{solution.mass:.3f}{PLUS_MINUS}{solution.mass_sigma:.3f} kg measured"
    found = [
        f"total CoM off the measured line on these {len(after.poses)} poses: "
        f"{before.com_rms * MM:.2f} mm rms with the URDF, {after.com_rms * MM:.2f} mm with the "
        "exported model (fitted to them: judge it on other poses)"
    ]
    if not np.isfinite(solution.mass):
        found.append("mass: not measured, so neither is the total CoM")
    elif solution.adjustment.unknowns.free_masses:
        found.append(
            f"mass: {measured}, {urdf:.3f} kg in {there}: masses of links were looked for, and "
            "are written with inertias in proportion"
        )
    elif model.mass_ratio == 1.0:
        found.append(f"mass: {measured}, {urdf:.3f} kg in {there}, which agrees and stays")
    elif model.masses_written:
        found.append(
            f"mass: {measured}, {urdf:.3f} kg in {there}: all masses and inertias are "
            f"multiplied by {model.mass_ratio:.4f}"
        )
    else:
        found.append(
            f"mass: {measured}, {urdf:.3f} kg in {there}: the masses stay, for a common factor "
            f"({model.mass_ratio:.4f}) cannot be told from a gain of the sensors (--scale-masses "
            "writes it). The CoMs are those that give the measured total CoM either way, and "
            "differ from the table of solve"
        )
    if summary.verdict == "not_identifiable":
        found.append(
            "verdict of the result: not identifiable. Only sums are measured; use the model for "
            "postures like these poses alone"
        )
    elif summary.verdict == "failed":
        found.append("verdict of the result: FAILED its limits")
    if solution.misfit_p < MISFIT:
        found.append(
            f"the model does not explain the data within their noise (p = {solution.misfit_p:.0e}, "
            f"limit {MISFIT:g}): the sigmas are too small"
        )
    found += part_lines(summary.parts)
    found += [f"{f.level.value}: {f.where}: {f.what} ({f.measured})" for f in summary.findings]
    return found


def _component(link: ModelLink, axis: int) -> str:
    """Return one component with its change from the URDF and the mark of its provenance."""
    change = (link.com[axis] - link.urdf_com[axis]) * MM
    if link.provenance[axis] == PRIOR and abs(change) > HARDLY:
        return f"{link.com[axis] * MM:.2f} ({change:+.2f}) model"
    if link.provenance[axis] == PRIOR:
        return f"{link.com[axis] * MM:.2f} URDF"
    moved = f" ({change:+.2f})" if abs(change) > HARDLY else " (0)"
    mark = "" if link.provenance[axis] == MEASURED else " s"
    return f"{link.com[axis] * MM + 0.0:.2f}{moved}{mark}"
