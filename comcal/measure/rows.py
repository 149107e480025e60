# SPDX-License-Identifier: Apache-2.0
"""Appending to a CSV file so that every row that was finished stays, whatever kills the writer."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from comcal.errors import ConfigError, DataError
from comcal.measure.csv_file import format_cell
from comcal.measure.files import partial_path, sync_folder, write_atomically
from comcal.robot.tree import Array


def append_row(path: Path, row: Mapping[str, object]) -> None:
    """Append one row and sync it to the disk; the first row makes the file with its header.

    Parameters
    ----------
    path : Path
        Ends with a complete line (see :func:`repair_tail`), or does not exist.
    row : mapping from column name to cell
        Needs an integer ``pose``. Columns that the file has and the row has not stay empty.

    Raises
    ------
    ConfigError
        If the row has a column that the file has not, a line break in a word, or no pose id.
    OSError
        If the disk is full; what was written of the row is taken back.
    """
    if not isinstance(row.get("pose"), int):
        raise ConfigError("a row needs an integer pose", where=path.name)
    header = _header(path) or tuple(row)
    strange = [name for name in row if name not in header]
    if strange:
        raise ConfigError(
            f"the session has no column {strange[0]}",
            where=str(path),
            next_step="measure with the same sensors as before, or give a new folder with -s",
        )
    line = _line([format_cell(row.get(name)) for name in header])
    if not path.exists():
        write_atomically(path, _line(header))
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
    try:
        before = os.fstat(descriptor).st_size
        try:
            rest = line
            while rest:
                rest = rest[os.write(descriptor, rest) :]
            os.fsync(descriptor)
        except OSError:
            os.ftruncate(descriptor, before)
            raise
    finally:
        os.close(descriptor)


def repair_tail(path: Path) -> Path | None:
    """Move a last line that was cut off while it was written to ``<name>.partial-N``.

    Parameters
    ----------
    path : Path
        May be absent.

    Returns
    -------
    Path or None
        Where the piece is now; None if there was none.
    """
    if not path.exists():
        return None
    data = path.read_bytes()
    end = data.rfind(b"\n") + 1
    if end == len(data) and end > 0:
        return None
    if end == 0:  # not even the header is whole: the file as such is the piece
        aside = partial_path(path)
        path.rename(aside)
    else:
        aside = partial_path(path)
        with aside.open("xb") as file:
            file.write(data[end:])
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.parent)
        with path.open("r+b") as file:
            file.truncate(end)
            os.fsync(file.fileno())
    sync_folder(path.parent)
    return aside


def column_numbers(path: Path, columns: Sequence[str]) -> Array:
    """Return some columns of all complete rows.

    Parameters
    ----------
    path : Path
        May be absent.
    columns : sequence of str

    Returns
    -------
    array, shape (n_rows, n_columns)

    Raises
    ------
    DataError
        If a column is missing or a cell is no number.
    """
    if not path.exists():
        return np.zeros((0, len(columns)))
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    try:
        lines = list(csv.reader(io.StringIO(whole.decode("utf-8-sig"), newline="")))
        index = [lines[0].index(name) for name in columns] if lines else []
        cells = [[float(line[i]) for i in index] for line in lines[1:] if line]
    except (ValueError, IndexError, csv.Error) as problem:
        raise DataError(
            f"the table is damaged: {problem}",
            where=str(path),
            next_step="restore it from a copy, or delete the bad line",
        ) from problem
    return np.array(cells, dtype=np.float64).reshape(-1, len(columns))


def _header(path: Path) -> tuple[str, ...]:
    if not path.exists():
        return ()
    with path.open(encoding="utf-8-sig", newline="") as file:
        return tuple(next(csv.reader(file), ()))


def _line(cells: Sequence[str]) -> bytes:
    for cell in cells:
        if "\n" in cell or "\r" in cell:
            raise ConfigError(f"a cell holds a line break: {cell!r}", next_step="write one line")
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()
