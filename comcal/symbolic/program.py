# SPDX-License-Identifier: Apache-2.0
"""A formula as a straight line of named intermediate results, which printers turn into code.

Expanded, Cramer's rule for four links has thousands of terms and for six it does not fit into
memory. Written as steps that use one another it stays small, so nothing here is ever expanded.
Symbols that are ``real`` stand for real numbers, all others for complex ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from comcal.symbolic.algebra import Expr, Symbol, sp


@dataclass(frozen=True)
class Quantity:
    """An input: a real number, or an array of them.

    Parameters
    ----------
    name : str
        In generated code.
    symbols : tuple of sympy.Symbol
        Row by row.
    shape : tuple of int
        ``()`` for a number.
    meaning : str
        In words, with the frame.
    unit : str
    """

    name: str
    symbols: tuple[Symbol, ...]
    shape: tuple[int, ...]
    meaning: str
    unit: str


@dataclass(frozen=True)
class Output:
    """A result: a real number, or a list of them.

    Parameters
    ----------
    name : str
        In generated code.
    labels : tuple of str
        Name of each entry in formulas.
    values : tuple of sympy.Expr
        In terms of inputs and steps.
    is_list : bool
        False: a number; there is one value.
    meaning, unit : str
    """

    name: str
    labels: tuple[str, ...]
    values: tuple[Expr, ...]
    is_list: bool
    meaning: str
    unit: str


@dataclass(frozen=True)
class Statement:
    """A formula for the reader, which no code needs: the system, its determinant, a noise gain.

    Parameters
    ----------
    words : str
        What it says, one sentence.
    left, right : sympy.Basic or None
        The equation; None where the words say it all.
    """

    words: str
    left: Expr | None = None
    right: Expr | None = None


@dataclass(frozen=True)
class Program:
    """Inputs, steps and outputs of one derivation.

    Parameters
    ----------
    name : str
        Of the generated function.
    title : str
        One sentence without a full stop.
    inputs : tuple of Quantity
        Only those that the steps use.
    steps : tuple of (Symbol, Expr)
        Each in terms of inputs and earlier steps.
    outputs : tuple of Output
    statements : tuple of Statement
    """

    name: str
    title: str
    inputs: tuple[Quantity, ...]
    steps: tuple[tuple[Symbol, Expr], ...]
    outputs: tuple[Output, ...]
    statements: tuple[Statement, ...] = ()

    def only_used(self) -> Program:
        """Return the program without steps and inputs on which no output depends."""
        needed: set[Expr] = set()
        for output in self.outputs:
            for value in output.values:
                needed |= value.free_symbols
        steps: list[tuple[Symbol, Expr]] = []
        for symbol, value in reversed(self.steps):
            if symbol in needed:
                steps.append((symbol, value))
                needed |= value.free_symbols
        inputs = tuple(q for q in self.inputs if needed & set(q.symbols))
        return replace(self, inputs=inputs, steps=tuple(reversed(steps)))


@dataclass
class Steps:
    """The steps of a program while it is being written."""

    done: list[tuple[Symbol, Expr]] = field(default_factory=list[tuple[Symbol, Expr]])

    def let(self, name: str, value: Expr, *, real: bool = False) -> Expr:
        """Name an intermediate result and return its symbol; a number or a symbol needs no name."""
        if value.is_Atom or value.is_number:
            return folded(value)
        symbol = sp.Symbol(name, real=True) if real else sp.Symbol(name)
        self.done.append((symbol, value))
        return symbol


def folded(value: Expr) -> Expr:
    """Return a constant expression as one number, any other as it is.

    Parameters
    ----------
    value : sympy.Expr
    """
    if not value.is_number or value.is_Rational:
        return value
    number = complex(value)
    parts = [sp.Float(x) if x else sp.Integer(0) for x in (number.real, number.imag)]
    return parts[0] + sp.I * parts[1]


def real_symbols(names: Iterable[str]) -> tuple[Symbol, ...]:
    """Return real symbols by name."""
    return tuple(sp.Symbol(name, real=True) for name in names)


def scalar(name: str, meaning: str, unit: str) -> Quantity:
    """Return a number as input."""
    return Quantity(name, real_symbols([name]), (), meaning, unit)


def vector(name: str, letters: Sequence[str], meaning: str, unit: str) -> Quantity:
    """Return a list of numbers as input, one for each of *letters*."""
    symbols = real_symbols(f"{name}_{letter}" for letter in letters)
    return Quantity(name, symbols, (len(symbols),), meaning, unit)


def matrix(
    name: str, rows: Sequence[str], columns: Sequence[str], meaning: str, unit: str
) -> Quantity:
    """Return a table of numbers as input."""
    symbols = real_symbols(f"{name}_{row}_{column}" for row in rows for column in columns)
    return Quantity(name, symbols, (len(rows), len(columns)), meaning, unit)


def substituted(program: Program, values: dict[Symbol, float]) -> Program:
    """Return *program* with numbers in place of some inputs.

    Parameters
    ----------
    program : Program
    values : dict
        All symbols of an input, or none.
    """
    table = {
        symbol: sp.Float(value) if value else sp.Integer(0) for symbol, value in values.items()
    }
    steps: list[tuple[Symbol, Expr]] = []
    for symbol, value in program.steps:
        new = value.xreplace(table)
        if new.is_number or new.is_Atom:
            table[symbol] = folded(new)
        else:
            steps.append((symbol, new))
    outputs = tuple(
        replace(o, values=tuple(v.xreplace(table) for v in o.values)) for o in program.outputs
    )
    return replace(program, steps=tuple(steps), outputs=outputs).only_used()
