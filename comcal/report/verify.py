# SPDX-License-Identifier: Apache-2.0
"""What ``comcal verify`` says: mm per pose, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from comcal.identify.calibration import Check, Verdict
from comcal.identify.model_error import ModelError
from comcal.report.console import PLUS_MINUS, print_lines, print_table

FORMAT = "comcal-verification/1"
MM = 1e3
_UNIT = {"m": (1e3, "mm"), "kg": (1.0, "kg")}


@dataclass(frozen=True)
class Verification:
    """How well a URDF predicts the poses of a session.

    Parameters
    ----------
    urdf : Path
        The model that is judged.
    session : str
        Id of the session; empty if it was made by hand.
    error : ModelError
        Of the model that is judged.
    session_error : ModelError
        Of the session's own URDF, on the same poses.
    urdf_mass : float
        Of the whole robot, in the model that is judged [kg].
    """

    robot: str
    urdf: Path
    urdf_sha256: str
    session: str
    error: ModelError
    session_error: ModelError
    urdf_mass: float
    checks: tuple[Check, ...]
    verdict: Verdict
    notes: tuple[str, ...]


def verification_json(verification: Verification) -> dict[str, Any]:
    """Return a verification as JSON-able data.

    Parameters
    ----------
    verification : Verification
    """
    error = verification.error
    return {
        "format": FORMAT,
        "robot": verification.robot,
        "session": verification.session or None,
        "urdf": {"name": verification.urdf.name, "sha256": verification.urdf_sha256},
        "verdict": verification.verdict.value,
        "checks": [
            {"name": c.name, "measured": c.measured, "limit": c.limit, "unit": c.unit}
            for c in verification.checks
        ],
        "com_rms_mm": error.com_rms * MM,
        "com_upper_mm": error.com_upper * MM,
        "force_rms": error.force_rms,
        "moment_rms": error.moment_rms,
        "mass": {
            "value": error.mass,
            "sigma": error.mass_sigma,
            "urdf": verification.urdf_mass,
        },
        "session_urdf": {"com_rms_mm": verification.session_error.com_rms * MM},
        "poses": [
            {
                "pose": pose,
                "support": support,
                "com_mm": float(distance * MM),
                "force": float(force),
                "moment": float(moment),
            }
            for pose, support, distance, force, moment in zip(
                error.poses, error.supports, error.distance, error.force, error.moment, strict=True
            )
        ],
        "notes": list(verification.notes),
    }


def print_verification(console: Console, verification: Verification) -> None:
    """Print the errors pose by pose, ending in the verdict.

    Parameters
    ----------
    console : Console
    verification : Verification
    """
    error, before = verification.error, verification.session_error
    print_lines(console, (f"note: {note}" for note in verification.notes))
    heading = f"Predicted with {verification.urdf.name}, nothing fitted"
    print_lines(console, [heading], style="bold")
    rows = [
        (str(pose), support, f"{d * MM:.2f}", f"{f:.2f}", f"{m:.3f}", f"{s * MM:.2f}")
        for pose, support, d, f, m, s in zip(
            error.poses,
            error.supports,
            error.distance,
            error.force,
            error.moment,
            before.distance,
            strict=True,
        )
    ]
    header = ("pose", "support", "CoM off line mm", "force N", "moment N m", "session's URDF mm")
    print_table(console, rows, header)
    worst = int(np.argmax(error.distance))
    console.print()
    print_lines(
        console,
        [
            f"total CoM off the measured line by {error.com_rms * MM:.2f} mm rms (95 % upper end "
            f"{error.com_upper * MM:.2f} mm), {len(error.poses)} poses; worst "
            f"{error.distance[worst] * MM:.2f} mm in pose {error.poses[worst]}",
            f"force {error.force_rms:.2f} N rms, moment {error.moment_rms:.3f} N m rms",
            f"the session's own URDF: {before.com_rms * MM:.2f} mm rms{_times(error, before)}",
            f"mass {error.mass:.3f}{PLUS_MINUS}{error.mass_sigma:.3f} kg measured, "
            f"{verification.urdf_mass:.3f} kg in {verification.urdf.name} "
            f"({error.mass - verification.urdf_mass:+.3f} kg)",
            "",
        ],
    )
    words = {
        Verdict.PASSED: "PASSED",
        Verdict.FAILED: "FAILED",
        Verdict.NO_LIMITS: "NO LIMITS SET (robot.yaml: limits)",
    }
    print_lines(console, [f"Verdict: {words[verification.verdict]}"], style="bold")
    print_lines(console, (f"  {_check(check)}" for check in verification.checks))


def _times(error: ModelError, before: ModelError) -> str:
    ratio = before.com_rms / error.com_rms if error.com_rms > 0.0 else np.inf
    if not np.isfinite(ratio) or 0.95 < ratio < 1.05:
        return ""
    return f", {ratio:.1f} times as much"


def _check(check: Check) -> str:
    factor, unit = _UNIT[check.unit]
    sign = "<=" if check.passed else ">"
    return (
        f"{check.name}: {check.measured * factor:.3g} {unit} {sign} "
        f"{check.limit * factor:.3g} {unit}"
    )
