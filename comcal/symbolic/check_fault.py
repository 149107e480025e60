# SPDX-License-Identifier: Apache-2.0
"""The words for what is wrong with a formula."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from comcal.symbolic.formula_tree import Node


class FaultKind(Enum):
    """What is wrong with a term."""

    SIGN = "wrong sign"
    SINE_COSINE = "sine and cosine exchanged"
    INDEX = "wrong symbol or index"
    EXPONENT = "wrong power"
    COEFFICIENT = "wrong coefficient"
    FACTOR = "missing or superfluous factor"
    DROPPED = "term missing"
    EXTRA = "superfluous term"
    SEVERAL = "several terms"


@dataclass(frozen=True)
class TermFault:
    """The one change that makes a formula right.

    Parameters
    ----------
    kind : FaultKind
    term : str
        As printed, with its sign; empty if a term is missing.
    within : str
        The outermost term, or the bracket, in which it stands; empty if it is one itself.
    correct : str
        What the term must be; empty if it must go.
    corrected : str
        The whole formula after the change.
    """

    kind: FaultKind
    term: str
    within: str
    correct: str
    corrected: str


@dataclass(frozen=True)
class Reading:
    """What the search knows beside the formula.

    Parameters
    ----------
    names : mapping of Node to str
        The reader's own names.
    exclude : sequence of str
        Symbols that a correction may not use.
    still_says : callable
        Whether a corrected formula still speaks of the quantity: an equation can always be made
        true by taking it back on the other side.
    """

    names: Mapping[Node, str]
    exclude: Sequence[str]
    still_says: Callable[[Node], bool]
