# SPDX-License-Identifier: Apache-2.0
"""Straight-line C from sums of products: zeros vanish, ones are not multiplied, copies not made."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

WIDTH = 100
NEGLIGIBLE = 1e-15
"""Below this a constant is rounding: entries of rotations are 1 or less, vectors are metres."""


@dataclass(frozen=True)
class Term:
    """A number times variables; without variables it is a constant.

    Parameters
    ----------
    factor : float
    names : tuple of str
        C expressions that need no parentheses.
    """

    factor: float
    names: tuple[str, ...] = ()

    def __mul__(self, other: Term | float) -> Term:
        if not isinstance(other, Term):
            return Term(self.factor * other, self.names)
        return Term(self.factor * other.factor, self.names + other.names)

    def __neg__(self) -> Term:
        return self * -1.0


ZERO = Term(0.0)


def number(x: float) -> str:
    """Return a double as C reads it back to the last bit; never an integer."""
    text = repr(float(x))
    return text if any(mark in text for mark in ".en") else f"{text}.0"


@dataclass(frozen=True)
class _Line:
    """One line; a comment defines nothing and is no output."""

    text: str
    defines: str = ""
    uses: tuple[str, ...] = ()
    is_output: bool = False


class Block:
    """Lines of a C function, written one after the other; those nobody uses are left out."""

    def __init__(self) -> None:
        self._lines: list[_Line] = []

    def comment(self, text: str) -> None:
        """Head the lines that follow; without any of them left it goes too."""
        self._lines.append(_Line(f"/* {text} */"))

    def define(self, name: str, expression: str) -> Term:
        """Define a variable by an expression of the inputs and return it."""
        self._lines.append(_Line(f"const double {name} = {expression};", name))
        return Term(1.0, (name,))

    def total(self, name: str, terms: Iterable[Term]) -> Term:
        """Return the sum of *terms*, under *name* when it is more than a variable or a constant."""
        kept = _gathered(terms)
        if not kept:
            return ZERO
        if len(kept) == 1 and _is_free(kept[0]):
            return kept[0]
        self._lines.append(_Line(f"const double {name} = {_sum(kept)};", name, _names(kept)))
        return Term(1.0, (name,))

    def store(self, target: str, terms: Iterable[Term]) -> None:
        """Write the sum of *terms* to an output."""
        kept = _gathered(terms)
        self._lines.append(_Line(f"{target} = {_sum(kept)};", "", _names(kept), is_output=True))

    def text(self) -> str:
        """Return the lines that some output needs, indented by four."""
        needed: set[str] = set()
        kept: list[str] = []
        is_headed = True
        for line in reversed(self._lines):
            if line.is_output or line.defines in needed:
                needed.update(line.uses)
                kept.append(_wrapped(line.text))
                is_headed = False
            elif not line.defines:
                if not is_headed:
                    kept += [_wrapped(line.text), ""]
                is_headed = True
        return "\n".join(reversed(kept)).strip("\n")


def sum_of(terms: Iterable[Term]) -> str:
    """Return a sum as a C expression."""
    return _sum(_gathered(terms))


def _is_free(term: Term) -> bool:
    """Whether to repeat *term* costs no multiplication."""
    return not term.names or (len(term.names) == 1 and abs(term.factor) == 1.0)


def _names(terms: list[Term]) -> tuple[str, ...]:
    return tuple(name for term in terms for name in term.names)


def _gathered(terms: Iterable[Term]) -> list[Term]:
    """Return the terms with equal variables added, in order of appearance, dust removed."""
    factors: dict[tuple[str, ...], float] = {}
    for term in terms:
        key = tuple(sorted(term.names))
        factors[key] = factors.get(key, 0.0) + term.factor
    kept: list[Term] = []
    for names, factor in factors.items():
        if abs(factor) < NEGLIGIBLE:
            continue
        unit = bool(names) and abs(abs(factor) - 1.0) < NEGLIGIBLE
        kept.append(Term((1.0 if factor > 0.0 else -1.0) if unit else factor, names))
    return kept


def _sum(terms: list[Term]) -> str:
    """Return a sum as C, a positive term first where there is one."""
    if not terms:
        return "0.0"
    first = next((i for i, term in enumerate(terms) if term.factor > 0.0), 0)
    ordered = [terms[first], *terms[:first], *terms[first + 1 :]]
    text = _product(ordered[0])
    for term in ordered[1:]:
        text += f" - {_product(-term)}" if term.factor < 0.0 else f" + {_product(term)}"
    return text


def _product(term: Term) -> str:
    if not term.names:
        return number(term.factor)
    product = "*".join(term.names)
    if term.factor == 1.0:
        return product
    return f"-{product}" if term.factor == -1.0 else f"{number(term.factor)}*{product}"


def _wrapped(line: str) -> str:
    return textwrap.fill(
        line,
        WIDTH,
        initial_indent="    ",
        subsequent_indent="        ",
        break_long_words=False,
        break_on_hyphens=False,
    )
