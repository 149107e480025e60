# SPDX-License-Identifier: Apache-2.0
"""A CSV file as text cells that know the line they stand on.

One dialect, on purpose: UTF-8 (a byte order mark is allowed), cells separated by commas, numbers
with a decimal point. A file with semicolons or decimal commas is refused and told so, because
guessing the dialect is how 1,5 becomes 15. Lines that start with ``#`` before the header are
comments; empty lines are skipped. A file compressed by gzip is read as what it holds.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from comcal.errors import ComcalError, ConfigError, NotFiniteError
from comcal.robot.units import LARGEST, NUMBER

GZIP = b"\x1f\x8b"
"""First bytes of a compressed file."""

NOT_FINITE = re.compile(r"[+-]?(?:nan|na|n/a|null|none|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True)
class Row:
    """One line of a table: its line number in the file and its cells, stripped of blanks."""

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class CsvFile:
    """Header and rows of a CSV file.

    Parameters
    ----------
    path : Path
    header : tuple of str
        Column names, unique and not empty.
    rows : tuple of Row
        Every row has as many cells as the header.
    ends_with_newline : bool
        False when the last line may have been cut off while it was written.
    error : type of ComcalError
        What is raised when a cell is not what it should be.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[Row, ...]
    ends_with_newline: bool
    error: type[ComcalError]

    def where(self, row: Row) -> str:
        """Return ``file:line`` of *row*, for messages."""
        return f"{self.path.name}:{row.line}"

    def number(self, row: Row, column: int) -> float | None:
        """Return the number in a cell, None where the cell is empty.

        Raises
        ------
        NotFiniteError
            If the cell says NaN or infinity, or its number is too large for a float.
        ComcalError
            (``self.error``) if it is not a number, or one too large to be believed.
        """
        text = row.cells[column]
        if not text:
            return None
        name = self.header[column]
        if NUMBER.fullmatch(text):
            value = float(text)
            if abs(value) <= LARGEST:
                return value
            if math.isfinite(value):
                raise self.error(
                    f"column {name} holds a number that nothing on a robot can have",
                    where=self.where(row),
                    measured=f"{value:g}",
                    limit=f"{LARGEST:g}",
                    next_step="check the unit and whether the line is damaged",
                )
        if NUMBER.fullmatch(text) or NOT_FINITE.fullmatch(text):
            raise NotFiniteError(
                f"column {name} holds {shorten(text)!r} where a finite number is needed",
                where=self.where(row),
                next_step="measure it again, or leave the cell empty if it is optional",
            )
        raise self.error(
            f"column {name} holds {shorten(text)!r}, which is not a number",
            where=self.where(row),
            next_step="write numbers with a decimal point and without units, such as -0.25",
        )

    def integer(self, row: Row, column: int) -> int:
        """Return the integer in a cell.

        Raises
        ------
        ComcalError
            (``self.error``) if the cell is empty or not an integer.
        """
        value = self.number(row, column)
        if value is None or not value.is_integer() or abs(value) > 2**53:
            raise self.error(
                f"column {self.header[column]} holds {shorten(row.cells[column])!r}, "
                "which is not an integer",
                where=self.where(row),
                next_step="write whole numbers: 1, 2, 3, ...",
            )
        return int(value)


def shorten(text: str, limit: int = 40) -> str:
    """Return *text*, cut to *limit* characters for a message."""
    return text if len(text) <= limit else text[: limit - 3] + "..."


def read_csv(
    path: Path | str, *, error: type[ComcalError] = ConfigError, whole_lines: bool = False
) -> CsvFile:
    """Read a comma-separated table.

    Parameters
    ----------
    path : Path or str
    error : type of ComcalError
        Class to raise for everything that is wrong with the file.
    whole_lines : bool
        Leave out a last line without line end, as a writer leaves behind that was killed.

    Raises
    ------
    ConfigError
        If there is no such file.
    ComcalError
        Of class *error*: not text, no header, a column twice, a row with too few
        or too many cells, a quote that never ends.
    """
    path = Path(path)
    try:
        text = _unpacked(path, path.read_bytes(), error).decode("utf-8-sig")
    except OSError as problem:
        raise ConfigError(
            f"cannot be read: {problem.strerror}", where=str(path), next_step="check the path"
        ) from problem
    except UnicodeDecodeError as problem:
        raise error(
            f"is not UTF-8 text (byte {problem.start})",
            where=str(path),
            next_step="export it as comma-separated UTF-8",
        ) from problem
    if "\0" in text:
        raise error("holds a NUL byte, so it is not text", where=str(path), next_step=_EXPORT)
    ends_with_newline = text.endswith(("\n", "\r"))
    if whole_lines and not ends_with_newline:
        text = text[: text.rfind("\n") + 1]
    header, rows = _split(path, text, error)
    _check_header(path, header, error)
    if not rows:
        raise error("has a header but no rows", where=str(path), next_step="add at least one row")
    return CsvFile(path, header, rows, ends_with_newline, error)


def _unpacked(path: Path, content: bytes, error: type[ComcalError]) -> bytes:
    if not content.startswith(GZIP):
        return content
    try:
        return gzip.decompress(content)
    except (EOFError, gzip.BadGzipFile, zlib.error) as problem:
        raise error(
            f"is compressed, and damaged: {problem}",
            where=str(path),
            next_step="copy it again, or unpack it with gunzip to see what is left",
        ) from problem


_EXPORT = "export it as comma-separated UTF-8 text with one header row"


def _split(
    path: Path, text: str, error: type[ComcalError]
) -> tuple[tuple[str, ...], tuple[Row, ...]]:
    header: tuple[str, ...] = ()
    rows: list[Row] = []
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 0
    try:
        for cells in reader:
            start, line = line + 1, reader.line_num
            stripped = tuple(cell.strip() for cell in cells)
            if not any(stripped) and len(stripped) <= 1:
                continue
            if not header:
                if not stripped[0].startswith("#"):
                    header = stripped
                continue
            if len(stripped) != len(header):
                raise error(
                    f"has {len(stripped)} cells where the header has {len(header)} columns",
                    where=f"{path.name}:{start}",
                    next_step="complete the line, or delete it if it was cut off",
                )
            rows.append(Row(start, stripped))
    except csv.Error as problem:
        raise error(
            f"is not a valid CSV line: {problem}",
            where=f"{path.name}:{reader.line_num}",
            next_step=_EXPORT,
        ) from problem
    return header, tuple(rows)


def _check_header(path: Path, header: Sequence[str], error: type[ComcalError]) -> None:
    where = f"{path.name}"
    if not header:
        raise error("is empty", where=where, next_step=_EXPORT)
    if len(header) == 1 and any(mark in header[0] for mark in ";\t|"):
        raise error(
            "its columns are not separated by commas",
            where=where,
            next_step="export it with commas between cells and points in numbers",
        )
    empty = [str(i + 1) for i, name in enumerate(header) if not name]
    if empty:
        raise error(
            f"column number {', '.join(empty)} has no name",
            where=where,
            next_step="name every column in the header row",
        )
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise error(
            f"column {', '.join(shorten(name) for name in twice)} stands in the header twice",
            where=where,
            next_step="rename or delete one of the two",
        )


def write_csv(path: Path | str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a new table; floats are written so that reading them gives the same bits.

    Parameters
    ----------
    path : Path or str
        Must not exist.
    header : sequence of str
    rows : iterable of sequences
        Cells: str, int, float or None (empty cell). NaN becomes an empty cell.

    Raises
    ------
    ConfigError
        If the file exists or cannot be written.
    """
    path = Path(path)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([format_cell(cell) for cell in row] for row in rows)
    try:
        with path.open("x", encoding="utf-8", newline="") as file:
            file.write(text.getvalue())
    except FileExistsError as problem:
        raise ConfigError(
            "exists already and nothing is ever overwritten",
            where=str(path),
            next_step="give another name",
        ) from problem
    except OSError as problem:
        raise ConfigError(
            f"cannot be written: {problem.strerror}", where=str(path), next_step="check the path"
        ) from problem


def format_cell(cell: object) -> str:
    """Return the text of one cell: exact floats, empty for None and NaN."""
    if cell is None:
        return ""
    if isinstance(cell, float):  # numpy's float64 is a float too, but its repr has its type
        return "" if math.isnan(cell) else repr(float(cell))
    return str(cell)
