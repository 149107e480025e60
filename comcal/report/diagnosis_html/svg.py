# SPDX-License-Identifier: Apache-2.0
"""Small SVG charts: the frame, the axes and the numbers beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from comcal.report.diagnosis_html.markup import Markup, element

WIDTH, HEIGHT = 340.0, 150.0
"""Of a small multiple; it is drawn about as large on a phone and in columns on a desktop."""
LEFT, RIGHT, TOP, BOTTOM = 46.0, 8.0, 8.0, 20.0


def figure(
    title: str, width: float, height: float, *children: Markup, describes: str = ""
) -> Markup:
    """Return an SVG that scales with its box and is read out by its title.

    Parameters
    ----------
    title : str
    width, height : float
        Of the drawing, in its own units.
    *children : Markup
    describes : str
        What it shows, for people who cannot see it.
    """
    about = [element("title", title)]
    if describes:
        about.append(element("desc", describes))
    return element(
        "svg",
        *about,
        *children,
        xmlns="http://www.w3.org/2000/svg",
        viewBox=f"0 0 {width:g} {height:g}",
        role="img",
        aria_label=f"{title}. {describes}" if describes else title,
    )


@dataclass(frozen=True)
class Frame:
    """Where values over poses lie in a small multiple.

    Parameters
    ----------
    n : int
        Number of poses, side by side.
    low, high : float
        Of the values.
    """

    n: int
    low: float
    high: float

    def x(self, i: float) -> float:
        """Return the place of pose number *i*.

        Parameters
        ----------
        i : float
        """
        return LEFT + (i + 0.5) * (WIDTH - LEFT - RIGHT) / max(self.n, 1)

    def y(self, value: float) -> float:
        """Return the height of a value, kept within the chart.

        Parameters
        ----------
        value : float
        """
        value = min(max(value, self.low), self.high)
        share = (value - self.low) / (self.high - self.low)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)


def framed(values: Iterable[float], n: int, *, zero: bool) -> Frame:
    """Return a frame that holds all finite values.

    Parameters
    ----------
    values : iterable of float
    n : int
        Number of poses.
    zero : bool
        Whether zero is in it.
    """
    finite = [v for v in values if math.isfinite(v)] + ([0.0] if zero else [])
    low, high = (min(finite), max(finite)) if finite else (-1.0, 1.0)
    room = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return Frame(n, low - room, high + room)


def axes(frame: Frame, poses: Sequence[int]) -> list[Markup]:
    """Return round numbers at the left, pose ids below, and lines between.

    Parameters
    ----------
    frame : Frame
    poses : sequence of int
        Ids.
    """
    drawn: list[Markup] = []
    ticks = round_numbers(frame.low, frame.high)
    for tick in ticks:
        y = frame.y(tick)
        kind = "zero" if tick == 0.0 else "rule"
        drawn.append(element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=y, y2=y, class_=kind))
        label = tick_text(tick, ticks)
        drawn.append(element("text", label, x=LEFT - 5, y=y + 3.5, text_anchor="end"))
    for i in _spread(len(poses), 8):
        drawn.append(
            element("text", str(poses[i]), x=frame.x(i), y=HEIGHT - 5, text_anchor="middle")
        )
    return drawn


def _spread(n: int, most: int) -> range:
    return range(0, n, max(math.ceil(n / most), 1))


def round_numbers(low: float, high: float, about: int = 4) -> tuple[float, ...]:
    """Return multiples of 1, 2 or 5 times a power of ten between two values.

    Parameters
    ----------
    low, high : float
    about : int
        How many are wanted.
    """
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough)
    return tuple(k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1))


def tick_text(tick: float, ticks: Sequence[float]) -> str:
    """Return a number with the decimals that its neighbours need.

    Parameters
    ----------
    tick : float
    ticks : sequence of float
        All of the axis, evenly spaced.
    """
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(tick) or 1.0
    if max(abs(t) for t in ticks) >= 1e5 or step < 1e-4:
        return f"{tick:.3g}"
    return f"{tick:.{max(-math.floor(math.log10(step) + 1e-9), 0)}f}"
