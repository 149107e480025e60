# SPDX-License-Identifier: Apache-2.0
"""The signature matrix: in which kinds of residuals a cause and its rivals show."""

from __future__ import annotations

from comcal.diagnose.diagnosis import Diagnosis
from comcal.report.diagnosis_html.markup import Markup, element, joined
from comcal.report.diagnosis_html.svg import figure

LABEL, ROW, HEAD = 210.0, 26.0, 120.0
WIDE, NARROW, MANY = 46.0, 22.0, 10
"""Widths of a cell, and the number of columns from which it is narrow and has no number."""
SEEN = 0.01
"""Kinds of residuals that hold less than this of every effect are left out."""


def matrix_section(diagnosis: Diagnosis) -> Markup:
    """Return the matrix with causes named first, their rivals below; empty without signatures.

    Parameters
    ----------
    diagnosis : Diagnosis
    """
    if not diagnosis.signatures:
        return joined()
    return element(
        "section",
        element("h2", "Signatures of causes and rivals"),
        element(
            "p",
            "How the squared norm of each one's effect is shared out among the residuals, in per "
            "cent. Rows that look alike are hard to tell apart; what differs is what to measure.",
        ),
        element("div", _chart(diagnosis), class_="scroll"),
    )


def _chart(diagnosis: Diagnosis) -> Markup:
    signatures = diagnosis.signatures
    named = {cause.name for cause in diagnosis.causes}
    kinds = [
        kind
        for kind in dict.fromkeys(kind for shares in signatures.values() for kind in shares)
        if any(shares.get(kind, 0.0) >= SEEN for shares in signatures.values())
    ]
    cell = NARROW if len(kinds) >= MANY else WIDE
    rows = sorted(signatures, key=lambda name: name not in named)
    drawn: list[Markup] = []
    for k, kind in enumerate(kinds):
        x = LABEL + (k + 0.5) * cell
        turned = f"rotate(-50 {x:.1f} {HEAD - 8:.1f})"
        drawn.append(element("text", kind, x=x, y=HEAD - 8, transform=turned))
    for r, name in enumerate(rows):
        y = HEAD + r * ROW
        weight = "named" if name in named else "label"
        drawn.append(element("text", name, x=LABEL - 8, y=y + 17, text_anchor="end", class_=weight))
        for k, kind in enumerate(kinds):
            share = signatures[name].get(kind, 0.0)
            drawn.append(_cell(f"{name}, {kind}", share, LABEL + k * cell, y, cell))
    width, height = LABEL + len(kinds) * cell + 80, HEAD + len(rows) * ROW + 2
    chart = figure("Signature matrix", width, height, *drawn, describes=_words(diagnosis, rows))
    # Wide matrices scroll at a size that can be read, instead of shrinking.
    style = f"min-width:{width:.0f}px;max-width:{1.3 * width:.0f}px"
    return element("div", chart, style=style)


def _words(diagnosis: Diagnosis, rows: list[str]) -> str:
    return "; ".join(
        f"{name}: "
        + ", ".join(f"{kind} {100 * s:.0f} %" for kind, s in diagnosis.signatures[name].items())
        for name in rows
    )


def _cell(name: str, share: float, x: float, y: float, width: float) -> Markup:
    percent = f"{100 * share:.0f}"
    box = {"x": x, "y": y, "width": width - 2.0, "height": ROW - 2.0}
    parts = [
        element("title", f"{name}: {percent} %"),
        element("rect", **box, class_="frame"),
        element("rect", **box, class_="share", fill_opacity=share**0.5),
    ]
    if width > NARROW:
        kind = "percent strong" if share > 0.6 else "percent"
        middle = x + width / 2 - 1
        parts.append(
            element("text", percent, x=middle, y=y + 16, text_anchor="middle", class_=kind)
        )
    return element("g", *parts)
