# SPDX-License-Identifier: Apache-2.0
"""Programs as plain text: what goes in, why it is true, the steps, what comes out."""

from __future__ import annotations

import textwrap

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.program import Program

WIDTH = 98


def to_text(program: Program) -> str:
    """Return a program as text in sympy's notation, in which I * I = -1."""
    lines = [program.title, "=" * len(program.title), ""]
    lines.append("Given" if program.inputs else "Given: nothing")
    for q in program.inputs:
        shape = f" ({' x '.join(map(str, q.shape))})" if q.shape else ""
        lines += _wrapped(f"{q.name}{shape}: {q.meaning} [{q.unit}]")
    if program.statements:
        lines += ["", "Why"]
    for statement in program.statements:
        lines += _wrapped(statement.words)
        if statement.left is not None:
            equation = f"{_shown(statement.left)} = {_shown(statement.right)}"
            lines += textwrap.indent(equation, "      ").splitlines()
    if program.steps:
        lines += ["", "Steps"]
    lines += [f"  {symbol.name} = {sp.sstr(value)}" for symbol, value in program.steps]
    lines += ["", "Result"]
    for o in program.outputs:
        lines += _wrapped(f"{o.name}: {o.meaning} [{o.unit}]")
        lines += [
            f"      {label}" if sp.sstr(value) == label else f"      {label} = {sp.sstr(value)}"
            for label, value in zip(o.labels, o.values, strict=True)
        ]
    return "\n".join(lines) + "\n"


def _shown(value: Expr) -> str:
    """Return one side of an equation; of a product of matrices each on lines of its own."""
    if isinstance(value, sp.MatMul):
        return " * ".join(_shown(factor) for factor in value.args)
    if isinstance(value, sp.MatrixBase):
        rows = value.tolist()
        if value.cols == 1:
            entries = [sp.sstr(row[0]) for row in rows]
            short = sum(map(len, entries)) < WIDTH // 2
            return "[" + ("; " if short else ";\n ").join(entries) + "]"
        return "[" + ",\n ".join(f"[{', '.join(map(sp.sstr, row))}]" for row in rows) + "]"
    text: str = sp.sstr(value)
    return text


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="      ")
