# SPDX-License-Identifier: Apache-2.0
"""Residuals of every channel over the poses, with the model as given and as extended."""

from __future__ import annotations

import numpy as np

from comcal.diagnose.diagnosis import Diagnosis, Trace
from comcal.report.diagnosis_html.markup import Markup, element, joined
from comcal.report.diagnosis_html.svg import HEIGHT, WIDTH, Frame, axes, figure, framed
from comcal.report.display_units import shown_unit
from comcal.robot.tree import Array

OPEN = 12
"""Charts that are shown at once, the largest residuals first; the others unfold."""
BAND = 2.0
"""Half width of the band in sigmas: a healthy robot stays within it in 95 % of the poses."""


def traces_section(diagnosis: Diagnosis) -> Markup:
    """Return small multiples of all residuals; empty without any.

    Parameters
    ----------
    diagnosis : Diagnosis
    """
    if not diagnosis.traces:
        return joined()
    ordered = sorted(diagnosis.traces, key=_size, reverse=True)
    key = element(
        "p",
        element("span", "before", class_="key before"),
        " with the model as given, ",
        element("span", "after", class_="key after"),
        " with the causes named; the ",
        element("span", "band", class_="key band"),
        f" is {BAND:g} sigmas of noise and healthy spread together. Below: pose.",
    )
    parts = [
        element("h2", "Residuals before and after"),
        key,
        element("div", *(trace_chart(trace) for trace in ordered[:OPEN]), class_="grid"),
    ]
    if ordered[OPEN:]:
        parts.append(
            element(
                "details",
                element("summary", f"{len(ordered) - OPEN} more, smaller ones"),
                element("div", *(trace_chart(trace) for trace in ordered[OPEN:]), class_="grid"),
            )
        )
    return element("section", *parts)


def _size(trace: Trace) -> float:
    """Return the root mean square before, in sigmas."""
    seen = np.isfinite(trace.before) & (trace.sigma > 0.0)
    if not seen.any():
        return 0.0
    return float(np.sqrt(np.mean((trace.before[seen] / trace.sigma[seen]) ** 2)))


def trace_chart(trace: Trace) -> Markup:
    """Return one chart: the band, a ring before and a dot after for each pose.

    Parameters
    ----------
    trace : Trace
    """
    factor, unit = shown_unit(trace.unit)
    before, after, sigma = (a * factor for a in (trace.before, trace.after, trace.sigma))
    band = BAND * np.nan_to_num(sigma)
    frame = framed([*before, *after, *band, *(-band)], len(trace.poses), zero=True)
    marks: list[Markup] = []
    for i, (pose, b, a) in enumerate(zip(trace.poses, before, after, strict=True)):
        marks += _marks(frame, i, pose, float(b), float(a), unit)
    name = f"{trace.name} [{unit}]" if unit else trace.name
    drawn = figure(
        name,
        WIDTH,
        HEIGHT,
        _band(frame, band),
        *axes(frame, trace.poses),
        *marks,
        describes=f"largest residual {_largest(before)} {unit} before, {_largest(after)} after",
    )
    return element("figure", element("figcaption", name), drawn)


def _largest(values: Array) -> str:
    seen = values[np.isfinite(values)]
    return f"{np.abs(seen).max():.3g}" if seen.size else "-"


def _marks(frame: Frame, i: int, pose: int, b: float, a: float, unit: str) -> list[Markup]:
    if not np.isfinite(b) and not np.isfinite(a):
        return []
    words = element("title", f"pose {pose}: {b:.3g} {unit} before, {a:.3g} {unit} after")
    marks: list[Markup] = []
    if np.isfinite(b):
        marks.append(element("circle", cx=frame.x(i), cy=frame.y(b), r=2.6, class_="before"))
    if np.isfinite(a):
        marks.append(element("circle", cx=frame.x(i), cy=frame.y(a), r=2.2, class_="after"))
    return [element("g", words, *marks)]


def _band(frame: Frame, band: Array) -> Markup:
    """Return the band as one area, stepped from pose to pose."""
    upper = [
        f"{frame.x(i + side):.1f},{frame.y(float(width)):.1f}"
        for i, width in enumerate(band)
        for side in (-0.5, 0.5)
    ]
    lower = [
        f"{frame.x(i + side):.1f},{frame.y(-float(width)):.1f}"
        for i, width in reversed(list(enumerate(band)))
        for side in (0.5, -0.5)
    ]
    return element("polygon", points=" ".join([*upper, *lower]), class_="band")
