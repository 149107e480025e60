# SPDX-License-Identifier: Apache-2.0
"""What a hand-written formula claims, and what came of comparing it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from comcal.symbolic.check_fault import TermFault
from comcal.symbolic.check_quantities import Quantity


@dataclass(frozen=True)
class Line:
    """A formula of a file and where it stands.

    Parameters
    ----------
    text : str
    where : str
        ``file:line``.
    """

    text: str
    where: str


@dataclass(frozen=True)
class Claim:
    """A formula or a matrix that is said to be one of our quantities.

    Parameters
    ----------
    quantity : Quantity
    formula : Line or None
    matrix : sequence of sequence of Line
        Rows; empty if a formula is given.
    over : Line or None
        What the determinant of the matrix is divided by; None: det_A.
    symbols : mapping of str to Line
        The file's names and what they are in ours.
    configuration : mapping of str to Line
        Our angles that have a special value.
    links : int
        Number of links above the ankles.
    """

    quantity: Quantity
    formula: Line | None = None
    matrix: Sequence[Sequence[Line]] = ()
    over: Line | None = None
    symbols: Mapping[str, Line] = field(default_factory=dict[str, Line])
    configuration: Mapping[str, Line] = field(default_factory=dict[str, Line])
    links: int = 2


@dataclass(frozen=True)
class EntryReport:
    """One formula that was compared.

    Parameters
    ----------
    where : str
        ``file:line``.
    place : tuple of int or None
        Row and column from 1, in a matrix.
    text : str
        As printed.
    worst, median : float
        Difference from the truth relative to the terms of the formula [1].
    right_at : float
        Share of the points at which it is right [1].
    fault : TermFault or None
        None if it is right, or if no single change makes it right.
    """

    where: str
    place: tuple[int, int] | None
    text: str
    worst: float
    median: float
    right_at: float
    fault: TermFault | None = None

    @property
    def agrees(self) -> bool:
        """Whether the formula is right at every point."""
        return self.right_at == 1.0


@dataclass(frozen=True)
class FormulaReport:
    """What came of a check.

    Parameters
    ----------
    quantity : Quantity
    points : int
        At which it was compared.
    entries : tuple of EntryReport
        In the order of the file.
    rewritten : bool
        Whether a matrix differs from ours in its entries and still has the right determinant.
    """

    quantity: Quantity
    points: int
    entries: tuple[EntryReport, ...]
    rewritten: bool = False

    @property
    def agrees(self) -> bool:
        """Whether the claim is right."""
        return self.rewritten or all(entry.agrees for entry in self.entries)

    @property
    def wrong(self) -> tuple[EntryReport, ...]:
        """What is not right, in the order of the file."""
        return () if self.rewritten else tuple(e for e in self.entries if not e.agrees)
