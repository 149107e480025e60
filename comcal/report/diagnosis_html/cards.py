# SPDX-License-Identifier: Apache-2.0
"""The parts of the page that are words and tables: causes, rivals, refused readings, residuals."""

from __future__ import annotations

from collections.abc import Iterable

from comcal.diagnose.diagnosis import Cause, Diagnosis, Finding, Verdict
from comcal.report.diagnosis import CHANNELS_SHOWN
from comcal.report.diagnosis_html.markup import Markup, element, joined, table
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
    parameter_texts,
    place_text,
    rival_texts,
    summary_of,
)


def listed(lines: Iterable[str]) -> Markup:
    """Return a bulleted list; empty without lines."""
    items = [element("li", line) for line in lines]
    return element("ul", *items) if items else joined()


def causes_section(diagnosis: Diagnosis) -> Markup:
    """Return a card for every cause named; empty without any.

    Parameters
    ----------
    diagnosis : Diagnosis
    """
    if not diagnosis.causes:
        return joined()
    partial = diagnosis.verdict is Verdict.UNEXPLAINED
    title = "Causes, partial: more is wrong, do not trust them" if partial else "Causes"
    return element("section", element("h2", title), *map(_card, diagnosis.causes))


def _card(cause: Cause) -> Markup:
    summary = summary_of(cause.change.effect)
    facts = [
        f"Size: {cause.size:.0f} sigmas; {in_favour(cause.log_odds)} against none of it.",
        f"Held-out poses: {gain_text(cause)}.",
        *(
            f"{word}: {text}."
            for word, text in (
                ("Shows as", cause.signature),
                ("Told from its rivals by", cause.separated_by),
            )
            if text
        ),
    ]
    rows = [(p.key, p.value, p.interval, p.note) for p in parameter_texts(cause)]
    rivals = rival_texts(cause.rivals)
    parts: list[Markup] = [element("h3", f"{cause.name}{f': {summary}' if summary else ''}")]
    if rows:
        parts.append(table(("parameter", "true minus assumed", "95 %", ""), rows))
    parts.append(listed(facts))
    if rivals:
        parts.append(table(("rival", "odds", "of the effect it cannot imitate"), rivals))
    if cause.remedy:
        parts.append(element("p", element("strong", "Remedy: "), f"{cause.remedy}."))
    return element("article", *parts, class_="card")


def undecided_section(diagnosis: Diagnosis) -> Markup:
    """Return what is not told apart, what would decide, and the place of what has no name.

    Parameters
    ----------
    diagnosis : Diagnosis
    """
    parts: list[Markup] = []
    if diagnosis.place is not None:
        parts += [
            element("h2", "Where something acts that the catalogue has no name for"),
            element("p", place_text(diagnosis.place)),
        ]
    if diagnosis.groups:
        parts += [
            element("h2", "These readings do not tell apart"),
            table(("cause", "odds", ""), group_rows(diagnosis)),
        ]
    if diagnosis.would_decide:
        parts += [element("h2", "What would decide"), listed(diagnosis.would_decide)]
    return element("section", *parts) if parts else joined()


def gain_section(diagnosis: Diagnosis) -> Markup:
    """Return what is gained on held-out poses, and what that does not prove."""
    rows = held_out_rows(diagnosis) if diagnosis.causes else []
    shown = (table(HELD_OUT_HEADER, rows),) if rows else ()
    title = element("h2", "Gain on held-out poses")
    return element("section", title, *shown, listed(gain_summary(diagnosis)))


def findings_section(findings: tuple[Finding, ...]) -> Markup:
    """Return which readings were refused; empty without any."""
    if not findings:
        return joined()
    rows = [
        (
            finding.change.name,
            finding.text,
            ", ".join(map(str, finding.poses)) or "all",
            finding.action,
            finding.remedy,
        )
        for finding in findings
    ]
    return element(
        "section",
        element("h2", "Readings refused or kept under reserve"),
        table(("what", "measured", "poses", "done about it", "remedy"), rows, wraps=True),
    )


def channels_section(diagnosis: Diagnosis) -> Markup:
    """Return the table of residuals by channel; empty without channels."""
    if not diagnosis.channels:
        return joined()
    rows = channel_rows(diagnosis.channels)
    parts = [
        element("h2", "Residuals by channel"),
        element("p", "Root mean square over the poses; 1 sigma is what a healthy robot shows."),
        table(CHANNEL_HEADER, rows[:CHANNELS_SHOWN]),
    ]
    rest = rows[CHANNELS_SHOWN:]
    if rest:
        summary = element("summary", f"{len(rest)} more, smaller ones")
        parts.append(element("details", summary, table(CHANNEL_HEADER, rest)))
    return element("section", *parts)


def blind_section(diagnosis: Diagnosis) -> Markup:
    """Return what these poses could not show; empty if nothing."""
    if not diagnosis.blind:
        return joined()
    title = "These poses and channels could not show"
    return element("section", element("h2", title), listed(blind_texts(diagnosis.blind)))
