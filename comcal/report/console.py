# SPDX-License-Identifier: Apache-2.0
"""The one place that makes consoles, so that colour and width are decided once.

Colour, cursor movement and progress appear on a terminal only, and never where ``NO_COLOR`` is
set. Text that goes to a file or a pipe is plain and of fixed width: two runs can be compared.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Sequence
from typing import IO

from rich.console import Console
from rich.table import Table

PLAIN_WIDTH = 100
"""Columns of text that does not go to a terminal, unless ``COLUMNS`` says otherwise."""
GAP = 2
"""Blanks between the columns of a table."""
PLUS_MINUS = " +/- "


def make_console(*, stderr: bool = False, file: IO[str] | None = None) -> Console:
    """Make the console that a command prints through.

    Parameters
    ----------
    stderr : bool
        Write to standard error (progress, notes) instead of standard output (results).
    file : text stream or None
        Write there instead.

    Returns
    -------
    Console
        ``console.is_terminal`` tells whether progress may be shown. Numbers are not highlighted,
        and ``[...]`` in text is printed as it is.
    """
    console = Console(stderr=stderr, file=file, highlight=False, markup=False, emoji=False)
    if not console.is_terminal and not os.environ.get("COLUMNS", "").isdigit():
        console.width = PLAIN_WIDTH
    return console


def print_table(
    console: Console, rows: Sequence[Sequence[str]], header: Sequence[str] = ()
) -> None:
    """Print aligned columns without lines between them.

    Parameters
    ----------
    console : Console
    rows : sequence of sequence of str
        All of one length. Where they do not fit the console, a value and its sigma move together;
        what still does not fit is wrapped within its column, and nothing is cut off.
    header : sequence of str
        Titles of the columns; without them the first column is what the rows are called.
    """
    tight = _tightened(console, rows)
    if _width(rows, header) > console.width and (
        console.width < PLAIN_WIDTH or _width(tight, header) <= console.width
    ):
        rows = tight
    table = Table(box=None, show_header=bool(header), pad_edge=False, padding=(0, GAP, 0, 0))
    for i in range(len(rows[0]) if rows else 0):
        title = header[i] if header else ""
        style = "bold" if not header and i == 0 else ""
        table.add_column(title, header_style="bold", style=style, overflow="fold")
    for row in rows:
        table.add_row(*row)
    with console.capture() as capture:
        console.print(table)
    # The padding of the last column would be noise in a file.
    console.file.write("".join(f"{line.rstrip()}\n" for line in capture.get().splitlines()))


def print_lines(console: Console, lines: Iterable[str], style: str = "") -> None:
    """Print lines, those too long for the console wrapped between words and indented further.

    Parameters
    ----------
    console : Console
    lines : iterable of str
        Leading blanks are kept.
    style : str
    """
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        # At least 40 columns for text, whatever somebody did to the window.
        width = max(console.width, len(indent) + 40)
        pieces = textwrap.wrap(
            line,
            width,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        console.print("\n".join(pieces), style=style, soft_wrap=True)


def _width(rows: Sequence[Sequence[str]], header: Sequence[str]) -> int:
    """Return how many columns a table takes when nothing is wrapped."""
    every = [*rows, header] if header else rows
    return sum(max(map(len, cells)) + GAP for cells in zip(*every, strict=True)) - GAP


def _tightened(console: Console, rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the rows with value and sigma written without blanks between them."""
    sign = "±" if console.encoding.lower().startswith("utf") else PLUS_MINUS.strip()
    return [[cell.replace(PLUS_MINUS, sign) for cell in row] for row in rows]
