# SPDX-License-Identifier: Apache-2.0
"""What somebody at a robot looks at over ssh: one screen about the pose that is waited for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from comcal.cli.grouped import losses_text, rates_text
from comcal.measure.observe import Footprint, JointWay, Observation
from comcal.measure.plan import DOUBLE, NONE
from comcal.measure.source import SourceStatus

JOINTS, SIGNALS = 6, 3
"""Rows shown of each."""

OLD = 1.0
"""Readings older than this are shown in red [s]."""

WARM = 2.0
"""A sensor that warmed by more than this is shown in yellow [K]."""

WRONG_LOAD = 0.1
"""A load that differs from the weight by more than this part is shown in yellow."""

COLUMNS, LINES = 29, 9
"""Size of the picture of the soles in characters; one is twice as high as wide."""

NARROW = 72
"""Terminals with fewer columns show no picture."""

GOOD, BAD, DOUBTFUL = "green", "red", "yellow"


@dataclass(frozen=True)
class Screen:
    """All that is on the screen.

    Parameters
    ----------
    observation : Observation
    number, total : int
        Of this pose and of all poses.
    age : float
        Since the observation was made [s].
    keys : str
        What can be typed; empty where nothing can.
    """

    observation: Observation
    number: int
    total: int
    age: float = 0.0
    keys: str = ""


def live_table(screen: Screen) -> RenderableType:
    """Return the picture of one instant, for a terminal of 80 columns and 24 lines.

    Parameters
    ----------
    screen : Screen
    """
    seen = screen.observation
    left = Group(_joints(seen), Text(), _motions(seen))
    return Group(
        _head(screen),
        left if seen.footprint is None else _Beside(left, seen.footprint),
        *_facts(screen),
        *([Text(screen.keys, style="dim")] if screen.keys else []),
    )


class _Beside:
    """Tables beside the picture of the soles; a narrow terminal gets its words alone."""

    def __init__(self, tables: RenderableType, footprint: Footprint) -> None:
        self._tables, self._footprint = tables, footprint

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if options.max_width < NARROW:
            yield Group(self._tables, _where(self._footprint))
            return
        grid = Table.grid(padding=(0, 3))
        grid.add_row(self._tables, picture(self._footprint))
        yield grid


def status_line(screen: Screen) -> str:
    """Return the same in one line, for logs and pipes.

    Parameters
    ----------
    screen : Screen
    """
    seen = screen.observation
    parts = [f"pose {seen.pose.pose} ({screen.number} of {screen.total}), {seen.waited:.0f} s"]
    if seen.joints:
        worst = seen.joints[0]
        parts.append(f"{worst.joint} {_size(worst, worst.way, sign=True)} to go")
    if seen.motions:
        m = seen.motions[0]
        parts.append(f"{m.name} sd {m.sd:.2g} drift {m.drift:.2g} {m.unit}")
    if np.isfinite(seen.weight):
        parts.append(f"load {seen.force:.0f} of {seen.weight:.0f} N")
    if seen.status is not None:
        parts.append(_lost(seen.status))
    if seen.reason:
        parts.append(f"waiting: {seen.reason}")
    return "; ".join(parts)


def picture(footprint: Footprint) -> Text:
    """Draw the soles from above, toes up, with a cross where the ground pushes.

    Parameters
    ----------
    footprint : Footprint
    """
    points = np.vstack([*footprint.soles, footprint.cop])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    span = np.maximum(points.max(axis=0) - points.min(axis=0), 1e-3)
    # x points up the screen, y to the left; a character is twice as high as wide.
    scale = float(max(span[0] / (2 * LINES - 2), span[1] / (COLUMNS - 1)))
    lines = max(3, min(LINES, int(np.ceil(span[0] / (2.0 * scale))) + 1))
    rows = [[" "] * COLUMNS for _ in range(lines)]
    for i in range(lines):
        for k in range(COLUMNS):
            offset = np.array([(lines - 1 - 2 * i) * scale, (0.5 * (COLUMNS - 1) - k) * scale])
            if any(_is_in(middle + offset, sole) for sole in footprint.soles):
                rows[i][k] = "·"
    away = footprint.cop - middle
    i = int(np.clip(round(0.5 * (lines - 1 - away[0] / scale)), 0, lines - 1))
    k = int(np.clip(round(0.5 * (COLUMNS - 1) - away[1] / scale), 0, COLUMNS - 1))
    is_inside = footprint.margin >= 0.0
    text = Text()
    for row in range(lines):
        line = Text("".join(rows[row]), style="dim")
        if row == i:
            line = Text.assemble(
                line[:k], ("+", f"bold {GOOD if is_inside else BAD}"), line[k + 1 :]
            )
        text.append_text(line).append("\n")
    return text.append_text(_where(footprint))


def _where(footprint: Footprint) -> Text:
    is_inside = footprint.margin >= 0.0
    where = "inside" if is_inside else "outside"
    text = f"CoP {abs(footprint.margin) * 1e3:.0f} mm {where} the soles"
    return Text(text, "" if is_inside else BAD)


def _is_in(point: np.ndarray, sole: np.ndarray) -> bool:
    """Whether a point is within a sole, whose corners go round counter-clockwise."""
    edge = np.roll(sole, -1, axis=0) - sole
    to = point - sole
    return bool((edge[:, 0] * to[:, 1] - edge[:, 1] * to[:, 0] >= 0.0).all())


def _head(screen: Screen) -> Text:
    seen = screen.observation
    stands = {DOUBLE: "on both feet", NONE: "held"}.get(
        seen.pose.support, f"on the {seen.pose.support} foot"
    )
    text = Text.assemble(
        (f"pose {seen.pose.pose}", "bold"), f" ({screen.number} of {screen.total}), {stands}"
    )
    if seen.is_via:
        text.append(", first beyond it", style="bold yellow")
    return text.append(f", since {seen.waited:.0f} s")


def _joints(seen: Observation) -> Table:
    table = _plain("joint", "is", "wanted", "to go")
    for way in seen.joints[:JOINTS]:
        limit = 0.0 if seen.is_via else seen.arrival
        style = GOOD if abs(way.way) <= limit else ""
        arrow = "" if abs(way.way) <= limit else (" ↑" if way.way > 0.0 else " ↓")
        table.add_row(
            way.joint,
            _size(way, way.measured),
            _size(way, way.wanted),
            Text(_size(way, way.way, sign=True) + arrow, style=style),
        )
    rest = len(seen.joints) - JOINTS
    if rest > 0:
        table.add_row(Text(f"and {rest} nearer", style="dim"), "", "", "")
    return table


def _motions(seen: Observation) -> Table:
    table = _plain("moves", "sd", "drift", "limit")
    if not seen.motions:
        table.add_row("not read for long enough", "", "", "")
    for m in seen.motions[:SIGNALS]:
        name, _, unit = m.name.partition(" of "), None, m.unit
        table.add_row(
            name[0] if m.name.startswith("CoP") else m.name,
            Text(f"{m.sd:.2f}", style=GOOD if m.sd <= m.sd_limit else BAD),
            Text(f"{m.drift:.2f}", style=GOOD if m.drift <= m.drift_limit else BAD),
            f"{m.sd_limit:.3g} {unit}",
        )
    return table


def _facts(screen: Screen) -> Iterable[RenderableType]:
    """Return the lines below the tables; those about which nothing is known are left out."""
    seen = screen.observation
    facts = Table.grid(padding=(0, 2))
    if np.isfinite(seen.weight):
        part = seen.force / seen.weight - 1.0
        style = DOUBTFUL if abs(part) > WRONG_LOAD else ""
        text = f"{seen.force:.1f} N of {seen.weight:.1f} N ({100 * part:+.1f} %)"
        facts.add_row("load", Text(text, style=style))
    if seen.temperatures:
        text = Text()
        for name, (now, change) in seen.temperatures.items():
            style = DOUBTFUL if abs(change) > WARM else ""
            text.append("  " if text else "").append(f"{name} {now:.1f} °C ({change:+.1f})", style)
        facts.add_row("warmth", text)
    if seen.status is not None:
        rates = rates_text(seen.status)
        if rates:
            facts.add_row("rates", rates)
        lost = _lost(seen.status)
        facts.add_row("losses", Text(lost, style="" if lost == "nothing lost" else DOUBTFUL))
        for note in seen.status.notes:
            facts.add_row("", Text(note, style=DOUBTFUL))
    age = Text(f"{screen.age:.1f} s old", style=BAD if screen.age > OLD else "")
    facts.add_row("readings", age)
    if seen.reason:
        facts.add_row("waiting", Text(seen.reason))
    return (facts,)


def _lost(status: SourceStatus) -> str:
    lost = losses_text(status)
    return lost or "nothing lost"


def _plain(first: str, *others: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column(first)
    for name in others:
        table.add_column(name, justify="right")
    return table


def _size(way: JointWay, value: float, *, sign: bool = False) -> str:
    """Return an angle in degrees or a length in millimetres."""
    number = np.degrees(value) if way.is_angle else 1e3 * value
    return f"{number:{'+' if sign else ''}.1f}{'°' if way.is_angle else ' mm'}"
