# SPDX-License-Identifier: Apache-2.0
"""The cells of ``poses.csv``, one column at a time, each checked for what it must be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from comcal.errors import DataError, NotFiniteError
from comcal.measure.columns import Header, near_miss
from comcal.measure.csv_file import CsvFile, Row, shorten
from comcal.measure.plan import DOUBLE, NONE
from comcal.robot.model import Base, Robot
from comcal.robot.tree import Array

STANCE_FRAME = "P"


@dataclass(frozen=True)
class PoseCells:
    """The rows of one file that are used.

    Parameters
    ----------
    file : CsvFile
    header : Header
    rows : tuple of Row
    robot : Robot
    """

    file: CsvFile
    header: Header
    rows: tuple[Row, ...]
    robot: Robot

    def optional(self, name: str) -> Array:
        """Return the numbers of a column, shape (N,); NaN where a cell or the column is absent."""
        if name not in self.header.index:
            return np.full(len(self.rows), np.nan)
        index = self.header.index[name]
        numbers = [self.file.number(row, index) for row in self.rows]
        return np.array([np.nan if x is None else x for x in numbers], dtype=np.float64)

    def required(self, name: str) -> Array:
        """Return the numbers of a column in which no cell may be empty, shape (N,).

        Raises
        ------
        NotFiniteError
            If one is.
        """
        values = self.optional(name)
        for i in np.flatnonzero(np.isnan(values)):
            raise NotFiniteError(
                f"column {name} is empty",
                where=self.where(int(i)),
                next_step="fill the cell, or drop the pose with use = 0",
            )
        return values

    def standard_error(self, name: str) -> Array:
        """Return the numbers of a column in which none may be negative, shape (N,).

        Raises
        ------
        DataError
            If one is.
        """
        values = self.optional(name)
        for i in np.flatnonzero(values < 0.0):
            raise DataError(
                f"column {name} is negative",
                where=self.where(int(i)),
                measured=f"{values[i]:g}",
                limit="0",
                next_step="give the standard error of the mean, which is never negative",
            )
        return values

    def words(self, name: str) -> tuple[str, ...]:
        """Return the texts of a column, empty where a cell or the column is absent."""
        if name not in self.header.index:
            return ("",) * len(self.rows)
        return tuple(row.cells[self.header.index[name]] for row in self.rows)

    @cached_property
    def ids(self) -> tuple[int, ...]:
        """The pose ids.

        Raises
        ------
        DataError
            If one is not an integer or stands twice.
        """
        ids: dict[int, Row] = {}
        for row in self.rows:
            pose = self.file.integer(row, self.header.index["pose"])
            if pose in ids:
                raise DataError(
                    f"pose {pose} stands in the table twice, first in line {ids[pose].line}",
                    where=self.file.where(row),
                    next_step="number it anew, or drop one of the two with use = 0",
                )
            ids[pose] = row
        return tuple(ids)

    def where(self, i: int) -> str:
        """Return ``file:line (pose id)`` of used row *i*."""
        return f"{self.file.where(self.rows[i])} (pose {self.ids[i]})"

    def supports(self) -> tuple[str, ...]:
        """Return the support of each pose.

        Raises
        ------
        DataError
            If one is neither ``double``, ``none`` nor a foot, or cannot be on this robot.
        """
        feet = tuple(self.robot.feet)
        both = () if len(feet) == 1 else (DOUBLE,)
        allowed = (NONE,) if self.robot.base is Base.FIXED else (*both, NONE, *feet)
        supports = self.words("support")
        for i, support in enumerate(supports):
            if support not in allowed:
                near = near_miss(support, allowed)
                raise DataError(
                    f"support {shorten(support)!r} is not one of {', '.join(allowed)}",
                    where=self.where(i),
                    next_step=f"did you mean {near}?"
                    if near
                    else "write double, none, or the name of the foot that stands",
                )
        return supports

    def approaches(self) -> Array:
        """Return the direction of arrival of each joint, shape (N, n_joints), NaN unknown.

        Raises
        ------
        DataError
            If one is not -1, 0 or 1.
        """
        joints = self.robot.tree.joint_names
        values = self.columns([f"approach.{joint}" for joint in joints])
        wrong = np.argwhere(~np.isnan(values) & ~np.isin(values, (-1.0, 0.0, 1.0)))
        for i, k in wrong:
            raise DataError(
                f"approach.{joints[k]} is {values[i, k]:g}",
                where=self.where(int(i)),
                next_step="write 1 (q was increasing), -1 (decreasing), 0 or nothing",
            )
        return values

    def com_frame(self) -> str:
        """Return the one frame in which CoM and CoP are given.

        Raises
        ------
        DataError
            If rows differ, or it is neither P nor a link.
        """
        frames = [frame or STANCE_FRAME for frame in self.words("com.frame")]
        for i, frame in enumerate(frames):
            if frame != frames[0]:
                raise DataError(
                    f"com.frame is {shorten(frame)} here and {shorten(frames[0])} before",
                    where=self.where(i),
                    next_step="give all CoMs of one file in one frame",
                )
        links = self.robot.tree.link_index
        if frames[0] != STANCE_FRAME and frames[0] not in links:
            near = near_miss(frames[0], links)
            raise DataError(
                f"com.frame {shorten(frames[0])} is not a link of {self.robot.name}",
                where=self.where(0),
                next_step=f"did you mean {near}?" if near else "write P or the name of a link",
            )
        return frames[0]

    def columns(self, names: Sequence[str]) -> Array:
        """Return several optional columns side by side, shape (N, len(names))."""
        if not names:
            return np.zeros((len(self.rows), 0))
        return np.column_stack([self.optional(name) for name in names])
