# SPDX-License-Identifier: Apache-2.0
"""What ``comcal export`` says of an extension: what the URDF holds of it, and what it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from comcal.identify.model_error import ModelError
from comcal.report.console import print_lines
from comcal.report.json_numbers import number
from comcal.robot.findings import Finding

MM = 1e3


@dataclass(frozen=True)
class ExtensionSummary:
    """What was exported of a model that no result was made with.

    Parameters
    ----------
    robot : str
    document : mapping
        The model as data.
    parts : tuple of (str, str)
        Each change, and where it belongs; empty where the URDF holds it.
    masses : tuple of float
        Of the whole robot in the old and in the new URDF [kg].
    diff : str
        From the session's URDF to the new one, unified.
    before, after : ModelError
        Of the session's URDF and of the whole model, on the poses of the session.
    findings : tuple of Finding
        What is doubtful about the new URDF and was not about the old one.
    files : tuple of Path
        What was written.
    """

    robot: str
    document: Mapping[str, Any]
    parts: tuple[tuple[str, str], ...]
    masses: tuple[float, float]
    diff: str
    before: ModelError
    after: ModelError
    findings: tuple[Finding, ...]
    files: tuple[Path, ...]


def part_lines(parts: Sequence[tuple[str, str]]) -> list[str]:
    """Return one sentence on what the URDF holds, and one for every part that it cannot hold.

    Parameters
    ----------
    parts : sequence of (str, str)
        Each change, and where it belongs; empty where the URDF holds it.
    """
    if not parts:
        return []
    held = [name for name, belongs in parts if not belongs]
    lines = [f"in the URDF: {', '.join(held) or 'nothing of the model'}"]
    return lines + [f"not in the URDF: {name}: {where}" for name, where in parts if where]


def extension_lines(summary: ExtensionSummary) -> list[str]:
    """Return what should be known about the exported model, one sentence each.

    Parameters
    ----------
    summary : ExtensionSummary
    """
    before, after = summary.before, summary.after
    lines = [
        "the model alone: nothing was fitted, for the newest result was not made with it",
        *part_lines(summary.parts),
        f"mass: {summary.masses[0]:.3f} kg in the URDF, {summary.masses[1]:.3f} kg in the new one",
    ]
    if before.poses:
        lines.append(
            f"total CoM off the measured line on the {len(after.poses)} poses of the session: "
            f"{before.com_rms * MM:.2f} mm rms with the URDF, {after.com_rms * MM:.2f} mm with the "
            "whole model"
        )
    lines += [f"{f.level.value}: {f.where}: {f.what} ({f.measured})" for f in summary.findings]
    return lines


def print_extension(console: Console, summary: ExtensionSummary) -> None:
    """Print what was written of a model, and what belongs elsewhere.

    Parameters
    ----------
    console : Console
    summary : ExtensionSummary
    """
    print_lines(console, extension_lines(summary))


def extension_json(summary: ExtensionSummary) -> dict[str, Any]:
    """Return the export of a model alone as JSON-able data.

    Parameters
    ----------
    summary : ExtensionSummary
    """
    return {
        "format": "comcal-exported-extension/1",
        "robot": summary.robot,
        **summary.document,
        "mass": {"urdf": summary.masses[0], "written": summary.masses[1]},
        "session_poses": {
            "poses": len(summary.after.poses),
            "com_rms_mm": {
                "urdf": number(summary.before.com_rms * MM),
                "model": number(summary.after.com_rms * MM),
            },
        },
        "notes": extension_lines(summary),
        "diff": summary.diff,
        "files": [str(path) for path in summary.files],
    }
