# SPDX-License-Identifier: Apache-2.0
"""Text of ``--as-published``: Muscolo 2017 to the letter, fault by fault, next to the truth."""

from __future__ import annotations

from comcal.statics.published import PublishedResult
from comcal.statics.published_chain import LinkComs
from comcal.statics.published_faults import AS_PUBLISHED, CORRECTED, FAULT_TEXT, Fault

MM = 1e3
HEADER = f"{'formulas':<34}{'Z_2c':>10}{'r_b':>10}{'l_b':>10}{'r_c':>10}{'l_c':>10}"


def published_heading(poses: tuple[int, ...], rank: int) -> list[str]:
    """Return what stands above the table.

    Parameters
    ----------
    poses : tuple of int
        Pose ids of a, b, c and, where there is one, of c's tilted twin.
    rank : int
        Of the force equations of a, b and c.
    """
    names = ("a", "b", "c", "c tilted")
    used = ", ".join(f"{n} = pose {p}" for n, p in zip(names, poses, strict=False))
    return [
        f"As published (Muscolo 2017), {used}; mm",
        f"the force data of a, b and c have rank {rank} of 4 unknowns (E4)",
        HEADER,
    ]


def published_row(faults: Fault, factor: float, result: PublishedResult | None, reason: str) -> str:
    """Return one line of the table: the link CoMs under some faults, or why there are none.

    Parameters
    ----------
    faults : Fault
    factor : float
        Sign of M_2 where it enters.
    result : PublishedResult or None
    reason : str
    """
    name = _name(faults, factor)
    if result is None:
        return f"{name:<34}{reason}"
    return f"{name:<34}{result.c.Z * MM:>10.2f}{_links(result.links)}"


def nominal_row(nominal: LinkComs) -> str:
    """Return the line that says what the URDF holds."""
    return f"{'URDF':<34}{'':>10}{_links(nominal)}"


def _links(links: LinkComs) -> str:
    return "".join(f"{v * MM:>10.2f}" for v in links.as_array())


def _name(faults: Fault, factor: float) -> str:
    sign = ""
    if Fault.INTERNAL_TORQUES in faults:
        sign = f", M_2 * {factor:+.0f}"
    if faults == CORRECTED:
        return "corrected"
    if faults == AS_PUBLISHED:
        return "as published, all together" + sign
    return FAULT_TEXT[faults] + sign
