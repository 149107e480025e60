# SPDX-License-Identifier: Apache-2.0
"""Angles as people write them: ``0``, ``30 deg``, ``theta_b``, ``theta_b - 0.5 * theta_c``."""

from __future__ import annotations

import ast
import keyword
import math
import operator
from collections.abc import Callable

from comcal.errors import ConfigError
from comcal.symbolic.algebra import Expr, sp

_OPERATORS: dict[type[ast.operator], Callable[[Expr, Expr], Expr]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def angle_of(text: object, where: str = "") -> Expr:
    """Return an angle as an expression in real symbols [rad]; nothing in it is executed.

    Parameters
    ----------
    text : object
        A number [rad] or a text; a text that ends in ``deg`` is in degrees.
    where : str
        For messages.

    Raises
    ------
    ConfigError
        If it is anything but numbers, names, ``pi``, ``+ - * /`` and brackets.
    """
    if isinstance(text, bool) or not isinstance(text, int | float | str):
        raise _refused(text, where)
    if not isinstance(text, str):
        return _number(text, text, where)
    words = text.strip()
    factor: Expr = sp.Integer(1)
    if words.endswith("deg"):
        words, factor = words[:-3].strip(), sp.pi / 180
    try:
        tree = ast.parse(words, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise _refused(text, where) from None
    return _value(tree.body, text, where) * factor


def _value(node: ast.expr, text: str, where: str) -> Expr:
    match node:
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            return _number(node.value, text, where)
        case ast.Name(id="pi"):
            return sp.pi
        case ast.Name(id=name) if not keyword.iskeyword(name):
            return sp.Symbol(name, real=True)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, text, where)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            a, b = _value(left, text, where), _value(right, text, where)
            if isinstance(op, ast.Div) and not (b.is_number and b != 0):
                raise _refused(text, where)
            return _OPERATORS[type(op)](a, b)
        case _:
            raise _refused(text, where)


def _number(value: object, text: object, where: str) -> Expr:
    if isinstance(value, int):
        return sp.Integer(value)
    if not isinstance(value, float) or not math.isfinite(value):
        raise _refused(text, where)
    return sp.Float(value)


def _refused(text: object, where: str) -> ConfigError:
    return ConfigError(
        f"{str(text)[:60]!r} is not an angle",
        where=where,
        next_step="write a number, as 0.5 or 30 deg, or names, as theta_b - theta_c",
    )
