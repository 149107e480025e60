# SPDX-License-Identifier: Apache-2.0
"""The ladder of causes: what was best at every step of the search, against the threshold."""

from __future__ import annotations

from comcal.diagnose.diagnosis import Diagnosis, Rung
from comcal.report.diagnosis_html.markup import Markup, element, joined
from comcal.report.diagnosis_html.svg import figure

WIDTH, ROW, NUMBER = 340.0, 32.0, 52.0
SHOWN = 6


def ladder_section(diagnosis: Diagnosis) -> Markup:
    """Return one chart per step; empty without any.

    Parameters
    ----------
    diagnosis : Diagnosis
    """
    if not diagnosis.ladder:
        return joined()
    return element(
        "section",
        element("h2", "Ladder of causes"),
        element(
            "p",
            "At every step, the causes that would explain most of what was left. Bars are log odds "
            "(3 is 20 to 1); a cause is named when it passes the line and no simpler set does.",
        ),
        element(
            "div", *(rung_chart(rung, i) for i, rung in enumerate(diagnosis.ladder)), class_="grid"
        ),
    )


def rung_chart(rung: Rung, step: int) -> Markup:
    """Return the bars of one step.

    Parameters
    ----------
    rung : Rung
    step : int
        From 0.
    """
    best = rung.best[:SHOWN]
    named = ", ".join(rung.named) or "nothing named yet"
    largest = max([rung.threshold * 1.15, *(odds for _, odds in best)], default=1.0)
    scale = (WIDTH - NUMBER) / max(largest, 1e-9)
    drawn: list[Markup] = []
    for row, (name, odds) in enumerate(best):
        y = row * ROW
        kind = "above" if odds >= rung.threshold else "below"
        length = max(odds, 0.0) * scale
        drawn += [
            element("text", name, x=0, y=y + 12, class_="label"),
            element("rect", x=0, y=y + 16, width=length, height=10, class_=kind),
            element("text", f"{odds:.1f}", x=length + 4, y=y + 25),
        ]
    height = max(len(best), 1) * ROW + 16
    x = rung.threshold * scale
    drawn += [
        element("line", x1=x, x2=x, y1=0, y2=height - 14, class_="threshold"),
        element("text", f"threshold {rung.threshold:.1f}", **_beside(x, height)),
    ]
    title = f"Step {step + 1}, chi2 {rung.chi2:.0f}: {named}"
    words = "; ".join(f"{name} {odds:.1f}" for name, odds in best)
    chart = figure(title, WIDTH, height, *drawn, describes=f"log odds: {words}")
    return element("figure", element("figcaption", title), chart)


def _beside(x: float, height: float) -> dict[str, str | float]:
    """Return where the word at the line stands: on the side that has room."""
    if x > WIDTH / 2.0:
        return {"x": x, "y": height - 3, "text_anchor": "end"}
    return {"x": x, "y": height - 3}
