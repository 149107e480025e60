# SPDX-License-Identifier: Apache-2.0
"""Text of ``comcal derive --check``: whether a formula is right, and which term is not."""

from __future__ import annotations

from comcal.symbolic.check_claim import EntryReport, FormulaReport
from comcal.symbolic.check_fault import FaultKind, TermFault

LONGEST = 500
"""Characters up to which a corrected formula is printed in full."""


def formula_report_lines(report: FormulaReport) -> list[str]:
    """Return a check as lines of text.

    Parameters
    ----------
    report : FormulaReport

    Returns
    -------
    list of str
        The verdict, then for every formula or entry that is wrong what makes it right.
    """
    quantity = report.quantity
    title = f"{quantity.name}: {quantity.meaning} [{quantity.unit}]"
    if quantity.equation:
        title += f", Muscolo 2017 {quantity.equation}"
    lines = [title]
    if report.agrees:
        lines.append(f"agrees with the moment balance at {report.points} random points")
        if report.rewritten:
            lines.append("the entries are not ours, but the quotient of the determinants is right")
        return lines
    of = (
        f"{len(report.wrong)} of {len(report.entries)} entries do" if _is_matrix(report) else "does"
    )
    lines.append(f"{of} NOT agree with the moment balance at {report.points} random points")
    for entry in report.wrong:
        lines += _entry_lines(entry)
    return lines


def _is_matrix(report: FormulaReport) -> bool:
    return len(report.entries) > 1


def _entry_lines(entry: EntryReport) -> list[str]:
    place = f"row {entry.place[0]}, column {entry.place[1]}, " if entry.place else ""
    head = f"  {place}{entry.where}: "
    if entry.fault is None:
        return [
            head + "no change of a single term makes it agree",
            f"    {entry.text}",
            f"    difference relative to its terms: median {entry.median:.1e}, largest "
            f"{entry.worst:.1e}; right at {100 * entry.right_at:.0f} % of the points",
        ]
    return [head + _fault_text(entry.fault), *_corrected(entry.fault)]


def _fault_text(fault: TermFault) -> str:
    inside = f", in {fault.within}" if fault.within else ""
    if fault.kind is FaultKind.DROPPED:
        return f"{fault.kind.value}: {fault.correct}{inside}"
    if fault.kind is FaultKind.SEVERAL:
        return f"no single term explains it; what is missing is {fault.correct}{inside}"
    if fault.kind is FaultKind.EXTRA:
        return f"{fault.kind.value}: {fault.term}{inside}; without it the rest agrees"
    return f"{fault.kind.value}: {fault.term}{inside}; with {fault.correct} the rest agrees"


def _corrected(fault: TermFault) -> list[str]:
    if fault.corrected == fault.correct.lstrip("+") or len(fault.corrected) > LONGEST:
        return []
    return [f"    corrected: {fault.corrected}"]
