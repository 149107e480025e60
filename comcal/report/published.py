# SPDX-License-Identifier: Apache-2.0
"""Text of ``--as-published``: Muscolo 2017 to the letter, fault by fault, next to the truth."""

from __future__ import annotations

from comcal.statics.published import PublishedResult
from comcal.statics.published_chain import LinkComs
from comcal.statics.published_faults import AS_PUBLISHED, CORRECTED, FAULT_TEXT, Fault

MM = 1e3
NAME, NUMBER = 34, 9
"""Widths of the columns: 79 in all."""
HEADER = f"{'formulas':<{NAME}}" + "".join(
    f"{name:>{NUMBER}}" for name in ("Z_2c", "r_b", "l_b", "r_c", "l_c")
)


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


def published_row(faults: Fault, factor: float, result: PublishedResult | None) -> str:
    """Return one line of the table: the link CoMs under some faults, or dashes.

    Parameters
    ----------
    faults : Fault
    factor : float
        Sign of M_2 where it enters.
    result : PublishedResult or None
    """
    name = f"{published_name(faults, factor):<{NAME}}"
    if result is None:
        return name + 5 * f"{'-':>{NUMBER}}"
    return f"{name}{_number(result.c.Z)}{_links(result.links)}"


def nominal_row(nominal: LinkComs) -> str:
    """Return the line that says what the URDF holds."""
    return f"{'URDF':<{NAME}}{'':>{NUMBER}}{_links(nominal)}"


def _links(links: LinkComs) -> str:
    return "".join(_number(v) for v in links.as_array())


def _number(length: float) -> str:
    # Adding zero turns -0.0 into 0.0.
    return f"{round(length * MM, 2) + 0.0:>{NUMBER}.2f}"


def published_name(faults: Fault, factor: float) -> str:
    """Return what a line of the table is called.

    Parameters
    ----------
    faults : Fault
    factor : float
        Sign of M_2 where it enters.
    """
    sign = ""
    if Fault.INTERNAL_TORQUES in faults:
        sign = f", {'+' if factor > 0 else '-'}M_2"
    if faults == CORRECTED:
        return "corrected"
    if faults == AS_PUBLISHED:
        return "as published, all together" + sign
    return FAULT_TEXT[faults] + sign
