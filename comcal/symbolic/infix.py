# SPDX-License-Identifier: Apache-2.0
"""Expressions in the infix notation that Python and C share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from comcal.symbolic.algebra import Expr, Symbol, sp

SUM, PRODUCT, ATOM = 0, 1, 2
"""How tightly a piece of text holds together."""


@dataclass(frozen=True)
class Notation:
    """What one language writes differently from another.

    Parameters
    ----------
    number : callable
        Text of a float.
    functions : mapping
        Name of a sympy function in the language, with ``{}`` for its argument.
    imaginary : str
        The imaginary unit; empty where there are no complex numbers.
    """

    number: Callable[[float], str]
    functions: Mapping[str, str]
    imaginary: str = ""


class Infix:
    """Writes expressions of one program.

    Parameters
    ----------
    notation : Notation
    names : mapping
        What to write for symbols that are not written by their own name.
    """

    def __init__(self, notation: Notation, names: Mapping[Symbol, str]) -> None:
        self._notation = notation
        self._names = names

    def write(self, value: Expr) -> str:
        """Return the text of an expression.

        Parameters
        ----------
        value : sympy.Expr
        """
        return self._write(value, SUM)

    def _write(self, value: Expr, inside: int) -> str:
        text, strength = self._piece(value)
        return f"({text})" if strength < inside else text

    def _piece(self, value: Expr) -> tuple[str, int]:
        if value.is_Symbol:
            return self._names.get(value) or value.name, ATOM
        if value is sp.I:
            return self._notation.imaginary, ATOM
        if value.is_Number or value is sp.pi:
            return self._number(value)
        if value.is_Add:
            return self._sum(value), SUM
        if value.is_Mul:
            return self._product(value)
        if value.is_Pow:
            return self._power(value)
        pattern = self._notation.functions[type(value).__name__]
        return pattern.format(self._write(value.args[0], SUM)), ATOM

    def _number(self, value: Expr) -> tuple[str, int]:
        if value.is_Rational and not value.is_Integer:
            over = f"{self._notation.number(value.p)} / {self._notation.number(value.q)}"
            return over, SUM if value.p < 0 else PRODUCT
        x = float(value)
        return self._notation.number(x), SUM if x < 0 else ATOM

    def _sum(self, value: Expr) -> str:
        text = ""
        for term in value.args:
            negative, positive = _sign(term)
            piece = self._write(positive, PRODUCT)
            if text:
                text += f" - {piece}" if negative else f" + {piece}"
            else:
                text = f"-{piece}" if negative else piece
        return text

    def _product(self, value: Expr) -> tuple[str, int]:
        negative, positive = _sign(value)
        if negative:
            return f"-{self._write(positive, PRODUCT)}", SUM
        above: list[str] = []
        below: list[str] = []
        for factor in value.args:
            base, exponent = factor.as_base_exp()
            if exponent.is_Number and exponent.is_negative and not factor.is_Number:
                below.append(self._write(base**-exponent, ATOM))
            elif factor.is_Rational and not factor.is_Integer:
                if factor.p != 1:
                    above.append(self._notation.number(factor.p))
                below.append(self._notation.number(factor.q))
            else:
                above.append(self._write(factor, PRODUCT))
        text = " * ".join(above) or self._notation.number(1)
        if below:
            under = " * ".join(below)
            text += f" / ({under})" if len(below) > 1 else f" / {under}"
        return text, PRODUCT

    def _power(self, value: Expr) -> tuple[str, int]:
        base, exponent = value.args
        if exponent.is_negative:
            under = self._write(base**-exponent, ATOM)
            return f"{self._notation.number(1)} / {under}", PRODUCT
        if exponent == sp.Rational(1, 2):
            return self._notation.functions["sqrt"].format(self._write(base, SUM)), ATOM
        if not exponent.is_Integer:
            raise NotImplementedError(f"power {exponent}")
        piece = self._write(base, ATOM)
        return " * ".join([piece] * int(exponent)), PRODUCT


def _sign(term: Expr) -> tuple[bool, Expr]:
    """Take a minus sign off a term."""
    if term.is_Number and term.is_negative:
        return True, -term
    if term.is_Mul and term.args[0].is_Number and term.args[0].is_negative:
        return True, -term
    return False, term
