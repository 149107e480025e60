# SPDX-License-Identifier: Apache-2.0
"""The text report of a diagnosis: what a person reads after ``comcal diagnose``."""

from __future__ import annotations

from rich.console import Console

from comcal.diagnose.diagnosis import Cause, Channel, Diagnosis, Finding, Verdict
from comcal.report.console import print_lines, print_table
from comcal.report.diagnosis_words import (
    CHANNEL_HEADER,
    HELD_OUT_HEADER,
    blind_texts,
    channel_rows,
    gain_summary,
    gain_text,
    group_rows,
    held_out_rows,
    in_favour,
    limit_words,
    parameter_texts,
    place_text,
    rival_texts,
    scale_texts,
    summary_of,
    verdict_words,
)

CHANNELS_SHOWN = 10
"""Rows of the table of residuals; the others are summed up in a line."""
RIVALS_SHOWN = 3


def print_diagnosis(console: Console, diagnosis: Diagnosis) -> None:
    """Print everything a diagnosis says, its first sentence first, ending in its verdict.

    Parameters
    ----------
    console : Console
    diagnosis : Diagnosis
    """
    print_lines(console, [diagnosis.sentence], style="bold")
    notes = (*diagnosis.notes, *scale_texts(diagnosis))
    print_lines(console, (f"note: {note}" for note in notes))
    _findings(console, diagnosis.findings)
    _causes(console, diagnosis)
    _groups(console, diagnosis)
    if diagnosis.place is not None:
        _heading(console, "Where something acts that the catalogue has no name for")
        print_lines(console, [place_text(diagnosis.place)])
    _channels(console, diagnosis.channels)
    _gain(console, diagnosis)
    if diagnosis.blind:
        _heading(console, "These poses and channels could not show")
        print_lines(console, [f"{'; '.join(blind_texts(diagnosis.blind))}"])
    console.print()
    print_diagnosis_verdict(console, diagnosis)


def print_diagnosis_verdict(console: Console, diagnosis: Diagnosis) -> None:
    """Print the one verdict, its limit beside what was measured."""
    print_lines(console, [f"Verdict: {verdict_words(diagnosis)}"], style="bold")
    print_lines(console, [f"  {limit_words(diagnosis)}"])


def _heading(console: Console, text: str) -> None:
    console.print()
    print_lines(console, [text], style="bold")


def _findings(console: Console, findings: tuple[Finding, ...]) -> None:
    if not findings:
        return
    _heading(console, "Readings refused or kept under reserve, before anything was fitted")
    for finding in findings:
        poses = f" (poses {_ids(finding.poses)})" if finding.poses else ""
        print_lines(console, [f"{finding.change.name}: {finding.text}{poses}"])
        remedy = f"; {finding.remedy}" if finding.remedy else ""
        print_lines(console, [f"  {finding.action}{remedy}"])


def _ids(poses: tuple[int, ...], shown: int = 8) -> str:
    more = f" and {len(poses) - shown} more" if len(poses) > shown else ""
    return ", ".join(map(str, poses[:shown])) + more


def _causes(console: Console, diagnosis: Diagnosis) -> None:
    if not diagnosis.causes:
        return
    partial = diagnosis.verdict is Verdict.UNEXPLAINED
    title = "Causes: true minus assumed, 95 % intervals"
    _heading(console, f"{title} (PARTIAL: more is wrong)" if partial else title)
    for i, cause in enumerate(diagnosis.causes):
        if i:
            console.print()
        _cause(console, cause)


def _cause(console: Console, cause: Cause) -> None:
    summary = summary_of(cause.change.effect)
    of = f": {summary}" if summary else ""
    print_lines(console, [f"{cause.name}{of}"], style="bold")
    rows = [(f"  {p.key}", p.value, p.interval, p.note) for p in parameter_texts(cause)]
    if rows:
        used = max(k for row in rows for k, cell in enumerate(row) if cell) + 1
        print_table(console, [row[:used] for row in rows])
    lines = [f"  size: {cause.size:.0f} sigmas; {in_favour(cause.log_odds)} against none of it"]
    if cause.signature:
        lines.append(f"  shows as: {cause.signature}")
    if cause.rivals:
        rivals = rival_texts(cause.rivals[:RIVALS_SHOWN])
        words = [f"{name} {chance} ({_unlike(left)})" for name, chance, left in rivals]
        more = len(cause.rivals) - RIVALS_SHOWN
        lines.append(f"  rivals: {', '.join(words)}{f', {more} more' if more > 0 else ''}")
    if cause.separated_by:
        lines.append(f"  told from them by: {cause.separated_by}")
    if cause.remedy:
        lines.append(f"  remedy: {cause.remedy}")
    print_lines(console, lines)


def _unlike(left: str) -> str:
    return f"{left} unlike" if left.endswith("%") else left


def _groups(console: Console, diagnosis: Diagnosis) -> None:
    if diagnosis.groups:
        _heading(console, "These readings do not tell apart")
        print_table(console, group_rows(diagnosis))
    if diagnosis.would_decide:
        _heading(console, "What would decide")
        print_lines(console, diagnosis.would_decide)


def _channels(console: Console, channels: tuple[Channel, ...]) -> None:
    if not channels:
        return
    _heading(console, "Residuals, root mean square; 1 sigma is what a healthy robot shows")
    print_table(console, channel_rows(channels[:CHANNELS_SHOWN]), CHANNEL_HEADER)
    rest = channels[CHANNELS_SHOWN:]
    if rest:
        before, after = (
            max(c.sigmas_before for c in rest),
            max(c.sigmas_after for c in rest),
        )
        line = f"{len(rest)} more, none above {before:.1f} sigmas before, {after:.1f} after"
        print_lines(console, [line])


def _gain(console: Console, diagnosis: Diagnosis) -> None:
    _heading(console, "Gain on held-out poses")
    if any(cause.gain is not None for cause in diagnosis.causes):
        print_lines(console, (f"{cause.name}: {gain_text(cause)}" for cause in diagnosis.causes))
    rows = held_out_rows(diagnosis)
    if rows and diagnosis.causes:
        print_table(console, rows, HELD_OUT_HEADER)
    print_lines(console, gain_summary(diagnosis))
