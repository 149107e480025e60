# SPDX-License-Identifier: Apache-2.0
"""The one place that makes consoles, so that colour and width are decided once.

Colour, cursor movement and progress appear on a terminal only, and never where ``NO_COLOR`` is
set. Text that goes to a file or a pipe is plain and of fixed width: two runs can be compared.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import IO

from rich.console import Console
from rich.table import Table

PLAIN_WIDTH = 100
"""Columns of text that does not go to a terminal, unless ``COLUMNS`` says otherwise."""


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
        All of one length. What does not fit the console's width is wrapped within its column.
    header : sequence of str
        Titles of the columns; without them the first column is what the rows are called.
    """
    table = Table(box=None, show_header=bool(header), pad_edge=False, padding=(0, 2, 0, 0))
    for i in range(len(rows[0]) if rows else 0):
        title = header[i] if header else ""
        table.add_column(title, header_style="bold", style="bold" if not header and i == 0 else "")
    for row in rows:
        table.add_row(*row)
    with console.capture() as capture:
        console.print(table)
    # The padding of the last column would be noise in a file.
    console.file.write("".join(f"{line.rstrip()}\n" for line in capture.get().splitlines()))
