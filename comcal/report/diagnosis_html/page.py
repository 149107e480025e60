# SPDX-License-Identifier: Apache-2.0
"""The whole page of one diagnosis, or of several side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from comcal.diagnose.diagnosis import Diagnosis
from comcal.report.diagnosis_html.cards import (
    blind_section,
    causes_section,
    channels_section,
    findings_section,
    gain_section,
    listed,
    undecided_section,
)
from comcal.report.diagnosis_html.ladder import ladder_section
from comcal.report.diagnosis_html.markup import Markup, element, joined, table
from comcal.report.diagnosis_html.matrix import matrix_section
from comcal.report.diagnosis_html.raw import RawChannel, raw_section
from comcal.report.diagnosis_html.style import STYLE
from comcal.report.diagnosis_html.traces import traces_section
from comcal.report.diagnosis_words import limit_words, scale_texts, verdict_words


@dataclass(frozen=True)
class PageSubject:
    """What a page is about.

    Parameters
    ----------
    title : str
        Such as the name of the session.
    diagnosis : Diagnosis
    raw : tuple of RawChannel
        Readings to show beside the residuals.
    facts : tuple of (str, str)
        Name and value, such as the robot's name and what ``comcal solve`` found.
    made_from : mapping from file name to SHA-256
    """

    title: str
    diagnosis: Diagnosis
    raw: tuple[RawChannel, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    made_from: Mapping[str, str] = field(default_factory=dict[str, str])


def diagnosis_page(subject: PageSubject) -> str:
    """Return the page of one diagnosis.

    Parameters
    ----------
    subject : PageSubject

    Returns
    -------
    str
        HTML that is well-formed XML as well.
    """
    return _page(subject.title, *_sections(subject))


def comparison_page(subjects: Sequence[PageSubject]) -> str:
    """Return one page of several diagnoses: a table, then each of them folded.

    Parameters
    ----------
    subjects : sequence of PageSubject
    """
    rows = [
        (
            s.title,
            s.diagnosis.verdict.value.replace("_", " "),
            ", ".join(cause.name for cause in s.diagnosis.causes) or "-",
            f"{s.diagnosis.misfit.chance:.2g}",
            _before_after(s.diagnosis),
            ", ".join(f"{name} {value}" for name, value in s.facts) or "-",
        )
        for s in subjects
    ]
    header = ("session", "verdict", "causes", "p", "held out, before -> after", "")
    folded = [
        element("details", element("summary", s.title), *_sections(s, level="h2")) for s in subjects
    ]
    title = f"{len(subjects)} sessions side by side"
    return _page(title, element("h1", title), table(header, rows), *folded)


def _before_after(diagnosis: Diagnosis) -> str:
    before, after = diagnosis.misfit.held_out_before, diagnosis.misfit.held_out_after
    return "-" if before is None or after is None else f"{before:.2f} -> {after:.2f}"


def _page(title: str, *sections: Markup) -> str:
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", f"comcal: {title}"),
        element("style", Markup(STYLE)),
    )
    body = element("body", element("main", *sections))
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _sections(subject: PageSubject, level: str = "h1") -> list[Markup]:
    diagnosis = subject.diagnosis
    doubtful = {pose for finding in diagnosis.findings for pose in finding.poses}
    verdict = element(
        "div",
        element("strong", verdict_words(diagnosis)),
        element("p", limit_words(diagnosis), class_="soft"),
        class_=f"verdict {diagnosis.verdict.value}",
    )
    return [
        element("p", subject.title, class_="soft"),
        element(level, diagnosis.sentence),
        verdict,
        _about(subject),
        listed((*diagnosis.notes, *scale_texts(diagnosis))),
        causes_section(diagnosis),
        undecided_section(diagnosis),
        gain_section(diagnosis),
        findings_section(diagnosis.findings),
        channels_section(diagnosis),
        traces_section(diagnosis),
        raw_section(subject.raw, doubtful),
        ladder_section(diagnosis),
        matrix_section(diagnosis),
        blind_section(diagnosis),
        _origin(subject),
    ]


def _about(subject: PageSubject) -> Markup:
    facts = [*subject.facts, ("poses", str(subject.diagnosis.poses))]
    if subject.diagnosis.used_rows:
        facts.append(("residuals in use", str(subject.diagnosis.used_rows)))
    return element("p", "; ".join(f"{name}: {value}" for name, value in facts), class_="soft")


def _origin(subject: PageSubject) -> Markup:
    if not subject.made_from:
        return joined()
    rows = [(name, digest) for name, digest in subject.made_from.items()]
    return element("footer", table(("made from", "sha256"), rows))
