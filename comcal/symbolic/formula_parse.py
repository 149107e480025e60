# SPDX-License-Identifier: Apache-2.0
"""Reading a formula in sympy's notation, without running it.

Only names, numbers, ``+ - * / **``, brackets, the functions of :data:`FUNCTIONS`, and one ``=``
are understood; everything else is refused with its place.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping

from comcal.errors import ConfigError
from comcal.robot.validate import did_you_mean
from comcal.symbolic.formula_tree import (
    CONSTANTS,
    FUNCTIONS,
    Node,
    as_sum,
    product,
    size_of,
    symbol,
)

LONGEST = 20_000
"""Characters of a formula."""
LARGEST = 5_000
"""Nodes of a formula."""
_EQUALS = re.compile(r"(?<![<>=!:])==?(?![=])")
_DEEP = (RecursionError, MemoryError)


def parse_formula(text: str, known: Mapping[str, Node], where: str) -> Node:
    """Return a formula as a sum, or as an equation of two sums.

    Parameters
    ----------
    text : str
        Such as ``m_b*r_b*cos(theta_b)`` or ``m_w*r_wb = m_b*(...)``.
    known : mapping of str to Node
        Every name that may occur, and what it stands for.
    where : str
        ``file:line``, for the message.

    Raises
    ------
    ConfigError
        If the text is not a formula, or uses a name or an operation that is not known.
    """
    if len(text) > LONGEST:
        raise ConfigError(
            "the formula is too long",
            where=where,
            measured=f"{len(text)} characters",
            limit=str(LONGEST),
            next_step="check it part by part",
        )
    reader = _Reader(known, where)
    try:
        sides = [reader.side(part) for part in _EQUALS.split(text)]
        if len(sides) == 1:
            root = sides[0]
        elif len(sides) == 2:
            root = Node("equation", children=(sides[0], sides[1]))
        else:
            raise reader.error(f"{len(sides) - 1} equals signs in one formula", "give one equation")
        size = size_of(root)
    except _DEEP:
        raise reader.error("the formula is nested too deeply", "check it part by part") from None
    if size > LARGEST:
        raise reader.error(
            f"the formula has {size} parts, more than {LARGEST}", "check it in parts"
        )
    return root


class _Reader:
    def __init__(self, known: Mapping[str, Node], where: str) -> None:
        self.known = known
        self.where = where

    def side(self, text: str) -> Node:
        if not text.strip():
            raise self.error("there is nothing on one side of the formula", "write both sides")
        try:
            # The brackets let a formula run over several lines.
            body = ast.parse(f"({text.strip()}\n)", mode="eval").body
        except (SyntaxError, ValueError) as error:
            column = (getattr(error, "offset", None) or 2) - 2
            near = text.strip()[max(0, column - 12) : column + 12].split("\n")[0]
            raise self.error(
                f"{text.strip()[:60]!r} is not a formula in sympy's notation",
                f"look near {near!r}; products need *, powers **",
            ) from None
        negative, node = self.term(body)
        if negative:
            return Node("sum", children=(node,), inverse=(True,))
        return as_sum(node)

    def term(self, node: ast.expr) -> tuple[bool, Node]:
        """Return whether a minus stands before *node*, and what follows it."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            negative, inner = self.term(node.operand)
            return negative != isinstance(node.op, ast.USub), inner
        if isinstance(node, ast.BinOp):
            if isinstance(node.op, (ast.Mult, ast.Div)):
                return self.product(node)
            if isinstance(node.op, (ast.Add, ast.Sub)):
                return False, self.sum(node)
            if isinstance(node.op, ast.Pow):
                base, exponent = self.whole(node.left), self.whole(node.right)
                return False, Node("power", children=(base, exponent))
            hint = "powers are written **" if isinstance(node.op, ast.BitXor) else "use + - * / **"
            raise self.error(f"the operation in {ast.unparse(node)[:60]!r} is not known", hint)
        return False, self.atom(node)

    def whole(self, node: ast.expr) -> Node:
        """Return *node* with its own sign inside."""
        negative, inner = self.term(node)
        return Node("sum", children=(inner,), inverse=(True,)) if negative else inner

    def sum(self, node: ast.BinOp) -> Node:
        """Return a + b - c, the terms in their order; a bracket stays a bracket."""
        terms: list[tuple[ast.expr, bool]] = []
        left: ast.expr = node
        while isinstance(left, ast.BinOp) and isinstance(left.op, (ast.Add, ast.Sub)):
            terms.append((left.right, isinstance(left.op, ast.Sub)))
            left = left.left
        terms.append((left, False))
        children, signs = [], []
        for term, subtracted in reversed(terms):
            negative, inner = self.term(term)
            children.append(inner)
            signs.append(negative != subtracted)
        return Node("sum", children=tuple(children), inverse=tuple(signs))

    def product(self, node: ast.BinOp) -> tuple[bool, Node]:
        """Return a*b/c; a minus before the first factor belongs to the whole term."""
        factors: list[tuple[ast.expr, bool]] = []
        left: ast.expr = node
        while isinstance(left, ast.BinOp) and isinstance(left.op, (ast.Mult, ast.Div)):
            factors.append((left.right, isinstance(left.op, ast.Div)))
            left = left.left
        negative, first = self.term(left)
        children, divides = [first], [False]
        for factor, divisor in reversed(factors):
            children.append(self.whole(factor))
            divides.append(divisor)
        return negative, Node("product", children=tuple(children), inverse=tuple(divides))

    def atom(self, node: ast.expr) -> Node:
        if isinstance(node, ast.Constant):
            return self.number(node)
        if isinstance(node, ast.Name):
            return self.name(node.id)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return self.call(node.func.id, node)
        raise self.error(
            f"{ast.unparse(node)[:60]!r} has no place in a formula",
            "use numbers, symbols, + - * / ** and " + ", ".join(FUNCTIONS),
        )

    def number(self, node: ast.Constant) -> Node:
        value = node.value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            try:
                if math.isfinite(float(value)):
                    return Node("number", repr(value))
            except OverflowError:
                pass
        raise self.error(f"{str(node.value)[:40]!r} is not a number that can be used", "")

    def name(self, name: str) -> Node:
        if name in self.known:
            return self.known[name]
        if name in CONSTANTS:
            return Node("number", name)
        hint = did_you_mean(name, [*self.known]) or "see the list of symbols of this quantity"
        raise self.error(
            f"symbol {name!r} is not known", f"{hint}, or say what it is under `symbols`"
        )

    def call(self, name: str, node: ast.Call) -> Node:
        arguments = [self.whole(a) for a in node.args]
        if name == "Rational" and len(arguments) == 2:
            return product(arguments[0], divisor=arguments[1])
        if name not in FUNCTIONS:
            hint = did_you_mean(name, [*FUNCTIONS])
            if name in self.known:
                hint = f"{name!r} is a symbol: write a * before the bracket"
            raise self.error(f"function {name!r} is not known", hint)
        count = FUNCTIONS[name][0]
        if len(arguments) != count or node.keywords:
            raise self.error(f"{name} takes {count} argument(s)", "")
        return Node("call", name, tuple(arguments))

    def error(self, what: str, next_step: str) -> ConfigError:
        return ConfigError(what, where=self.where, next_step=next_step)


def parse_symbol(text: str, known: Mapping[str, Node], where: str) -> Node:
    """Return what a name of the file stands for: a symbol of ours, or an expression in them.

    Parameters
    ----------
    text : str
        Such as ``theta_b`` or ``sin(theta_b)``.
    known : mapping of str to Node
    where : str
        ``file:line``, for the message.

    Raises
    ------
    ConfigError
        As :func:`parse_formula`, and for an equation.
    """
    root = parse_formula(text, known, where)
    if root.op == "equation":
        raise ConfigError("an equation cannot stand for a symbol", where=where)
    plain = len(root.children) == 1 and not root.inverse[0]
    return root.children[0] if plain else root


def own_names(names: list[str]) -> dict[str, Node]:
    """Return every one of *names* as the symbol it is."""
    return {name: symbol(name) for name in names}
