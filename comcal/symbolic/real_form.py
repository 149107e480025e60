# SPDX-License-Identifier: Apache-2.0
"""A program over complex numbers written as one over pairs of real ones.

For languages and compilers without complex numbers. Only the operations that programs consist of
are known; each is written out once, nothing is expanded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import chain

from comcal.symbolic.algebra import Expr, Symbol, sp
from comcal.symbolic.program import Program, Steps

Pair = tuple[Expr, Expr]
ZERO, ONE = sp.Integer(0), sp.Integer(1)


def real_form(program: Program) -> Program:
    """Return *program* with two real steps, ``_re`` and ``_im``, in place of each complex one."""
    parts: dict[Expr, Pair] = {}
    steps = Steps()
    for symbol, value in program.steps:
        re, im = split(value, parts)
        if symbol.is_real:
            parts[symbol] = (_kept(symbol, re, steps), ZERO)
        elif im == 0:
            parts[symbol] = (steps.let(f"{symbol.name}_re", re, real=True), ZERO)
        else:
            parts[symbol] = (
                steps.let(f"{symbol.name}_re", re, real=True),
                steps.let(f"{symbol.name}_im", im, real=True),
            )
    outputs = tuple(
        replace(o, values=tuple(split(value, parts)[0] for value in o.values))
        for o in program.outputs
    )
    return replace(program, steps=tuple(steps.done), outputs=outputs)


def split(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    """Return real and imaginary part of an expression.

    Parameters
    ----------
    value : sympy.Expr
    parts : dict
        Those of the complex symbols in it.
    """
    if value in parts:
        return parts[value]
    if value is sp.I:
        return ZERO, ONE
    if value.is_Atom:
        return value, ZERO
    if value.is_Add:
        return _sum(
            _product_terms([split(a, parts) for a in term.args])
            if term.is_Mul
            else _alone(split(term, parts))
            for term in value.args
        )
    if value.is_Mul:
        return _product([split(a, parts) for a in value.args])
    if value.is_Pow:
        return _power(value, parts)
    rule = _RULES.get(type(value), _real_function)
    return rule(value, parts)


def _kept(symbol: Symbol, value: Expr, steps: Steps) -> Expr:
    return steps.let(symbol.name, value, real=True)


def _alone(pair: Pair) -> tuple[list[Expr], list[Expr]]:
    return [pair[0]], [pair[1]]


def _sum(terms: Iterable[tuple[list[Expr], list[Expr]]]) -> Pair:
    re, im = zip(*terms, strict=True)
    return sp.Add(*chain.from_iterable(re)), sp.Add(*chain.from_iterable(im))


def _product(pairs: list[Pair]) -> Pair:
    return _sum([_product_terms(pairs)])


def _product_terms(pairs: list[Pair]) -> tuple[list[Expr], list[Expr]]:
    """Return the terms of real and imaginary part: sums of many products are added up once."""
    scale = sp.Mul(*(re for re, im in pairs if im is ZERO))
    turned = [pair for pair in pairs if pair[1] is not ZERO]
    if not turned:
        return [scale], []
    re, im = turned[0]
    if scale is not ONE:
        re, im = sp.Mul(scale, re), sp.Mul(scale, im)
    if len(turned) == 1:
        return [re], [im]
    for c, d in turned[1:-1]:
        re, im = (
            sp.Add(sp.Mul(re, c), sp.Mul(-1, im, d)),
            sp.Add(sp.Mul(re, d), sp.Mul(im, c)),
        )
    c, d = turned[-1]
    return [sp.Mul(re, c), sp.Mul(-1, im, d)], [sp.Mul(re, d), sp.Mul(im, c)]


def _power(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    base, exponent = value.args
    a, b = split(base, parts)
    if b == 0:
        return a**exponent, ZERO
    size = int(exponent)
    if size < 0:
        square = a**2 + b**2
        a, b = a / square, -b / square
    return _product([(a, b)] * abs(size))


def _exp(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    growth, angle = split(value.args[0], parts)
    if growth != 0:
        return _real_function(value, parts)
    return sp.cos(angle), sp.sin(angle)


def _abs(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    a, b = split(value.args[0], parts)
    return (sp.Abs(a) if b == 0 else sp.sqrt(a**2 + b**2)), ZERO


def _re(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    return split(value.args[0], parts)[0], ZERO


def _im(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    return split(value.args[0], parts)[1], ZERO


def _conjugate(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    a, b = split(value.args[0], parts)
    return a, -b


def _real_function(value: Expr, parts: dict[Expr, Pair]) -> Pair:
    a, b = split(value.args[0], parts)
    if b != 0:
        raise NotImplementedError(f"{type(value).__name__} of a complex number")
    return value.func(a), ZERO


_RULES: dict[type, Callable[[Expr, dict[Expr, Pair]], Pair]] = {
    sp.exp: _exp,
    sp.Abs: _abs,
    sp.re: _re,
    sp.im: _im,
    sp.conjugate: _conjugate,
}
