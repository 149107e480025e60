# SPDX-License-Identifier: Apache-2.0
"""The cells of a logger's CSV, converted to the columns and units of ``poses.csv``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from comcal.errors import ConfigError, DataError, MissingColumnError, NotFiniteError
from comcal.measure.columns import near_miss
from comcal.measure.csv_file import CsvFile, Row, shorten
from comcal.measure.map_file import ImportMap
from comcal.robot.tree import Array


@dataclass(frozen=True)
class LoggerTable:
    """All rows of a log, in columns of ``poses.csv``.

    Parameters
    ----------
    file : CsvFile
    numbers : mapping from column name to array, shape (n,)
        SI; NaN where a cell is empty. Constants are among them.
    words : mapping from column name to tuple of str
        Likewise.
    pose : tuple of int or None
        Numbers of the poses that rows belong to; None where no column says so. -1: to none.
    """

    file: CsvFile
    numbers: Mapping[str, Array]
    words: Mapping[str, tuple[str, ...]]
    pose: tuple[int, ...] | None

    def where(self, i: int) -> str:
        """Return ``file:line`` of row *i*."""
        return self.file.where(self.file.rows[i])

    def __len__(self) -> int:
        return len(self.file.rows)

    def between(self, start: float, end: float) -> LoggerTable:
        """Return the part from *start* to less than *end* [s], so that parts do not overlap.

        Raises
        ------
        MissingColumnError, NotFiniteError, DataError
            If the time is not mapped, has gaps or does not increase; if no sample is in the part.
        """
        t = increasing_time(self)
        a, b = (int(i) for i in np.searchsorted(t, [start, end]))
        if a >= b:
            raise DataError(
                f"no sample lies between {start:g} s and {end:g} s",
                where=self.file.path.name,
                measured=f"the log runs from {t[0]:g} s to {t[-1]:g} s",
                next_step="give times of the column t, in seconds",
            )
        return LoggerTable(
            replace(self.file, rows=self.file.rows[a:b]),
            {name: values[a:b] for name, values in self.numbers.items()},
            {name: words[a:b] for name, words in self.words.items()},
            None if self.pose is None else self.pose[a:b],
        )


def convert(file: CsvFile, plan: ImportMap) -> LoggerTable:
    """Pick and convert the mapped columns of a log.

    Parameters
    ----------
    file : CsvFile
    plan : ImportMap

    Raises
    ------
    MissingColumnError
        If the log lacks a mapped column.
    NotFiniteError
        If a cell is NaN or infinite.
    DataError
        If a cell is not a number.
    """
    index = {name: i for i, name in enumerate(file.header)}
    numbers: dict[str, Array] = {}
    words: dict[str, tuple[str, ...]] = {}
    pose: tuple[int, ...] | None = None
    for column in plan.columns:
        where = plan.located.where("columns", column.target.name)
        i = _index(column.source, index, file, where)
        if column.is_words:
            words[column.target.name] = tuple(row.cells[i] for row in file.rows)
        elif column.target.name == "pose":
            pose = _ids(file, i)
        else:
            values = _numbers(file, i)
            numbers[column.target.name] = column.factor * values + column.offset
    if plan.pose_ids:
        if pose is not None:
            raise ConfigError(
                "pose_ids and the column pose are two ways to say the same",
                where=plan.located.where("pose_ids"),
                next_step="keep one of the two",
            )
        pose = _ids(file, _index(plan.pose_ids, index, file, plan.located.where("pose_ids")))
    for name, value in plan.constants.items():
        if isinstance(value, str):
            words[name] = (value,) * len(file.rows)
        else:
            numbers[name] = np.full(len(file.rows), value)
    return LoggerTable(file, numbers, words, pose)


def _index(name: str, index: Mapping[str, int], file: CsvFile, where: str) -> int:
    if name not in index:
        near = near_miss(name, index)
        raise MissingColumnError(
            f"{file.path.name} has no column {shorten(name)!r}",
            where=where,
            next_step=f"did you mean {near!r}?"
            if near
            else f"its columns are {shorten(', '.join(index), 200)}",
        )
    return index[name]


def _numbers(file: CsvFile, i: int) -> Array:
    cells = [file.number(row, i) for row in file.rows]
    return np.array([np.nan if x is None else x for x in cells], dtype=np.float64)


def _ids(file: CsvFile, i: int) -> tuple[int, ...]:
    """Return pose numbers; an empty or negative one means that the row belongs to no pose."""

    def number(row: Row) -> int:
        return max(file.integer(row, i), -1) if row.cells[i] else -1

    return tuple(number(row) for row in file.rows)


def increasing_time(log: LoggerTable) -> Array:
    """Return the time of each row [s].

    Raises
    ------
    MissingColumnError
        If ``t`` is not mapped.
    NotFiniteError
        If a cell is empty.
    DataError
        If time does not increase.
    """
    if "t" not in log.numbers:
        raise MissingColumnError(
            "the time of the samples is not known",
            where=log.file.path.name,
            next_step="add `t: NAME` under columns in the map",
        )
    t = log.numbers["t"]
    complete(log, ["t"], range(len(log)))
    for i in np.flatnonzero(np.diff(t) <= 0.0):
        raise DataError(
            "time does not increase",
            where=log.where(int(i) + 1),
            measured=f"{t[i + 1]:g} s after {t[i]:g} s",
            next_step="check the column and unit of t, and whether two logs were joined",
        )
    return t


def complete(log: LoggerTable, names: Sequence[str], rows: Sequence[int] | range) -> Array:
    """Return columns that must have no gaps in some rows, shape (len(rows), len(names)).

    Raises
    ------
    NotFiniteError
        If a cell is empty.
    """
    values = np.column_stack([log.numbers[name][list(rows)] for name in names])
    for i, k in np.argwhere(np.isnan(values)):
        raise NotFiniteError(
            f"the cell for {names[k]} is empty",
            where=log.where(rows[i]),
            next_step="leave this stretch out of the windows, or repair the log",
        )
    return values


def common_word(log: LoggerTable, name: str, rows: Sequence[int] | range) -> str:
    """Return the one word that a column has in some rows.

    Raises
    ------
    DataError
        If there are several.
    """
    found = {log.words[name][i]: i for i in reversed(rows)}
    if len(found) > 1:
        first, second = list(found)[-1], list(found)[-2]
        raise DataError(
            f"{name} changes from {shorten(first)!r} to {shorten(second)!r} within one pose",
            where=log.where(found[second]),
            next_step="end the window before it changes",
        )
    return next(iter(found))
