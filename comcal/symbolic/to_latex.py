# SPDX-License-Identifier: Apache-2.0
r"""Programs as a LaTeX document that needs amsmath and amssymb only.

Steps are set as inline formulas, one a paragraph: TeX then breaks long sums between their terms.
"""

from __future__ import annotations

from comcal.symbolic.algebra import Expr, sp
from comcal.symbolic.latex_text import escaped, prose, tight
from comcal.symbolic.program import Program, Quantity

HEAD = r"""\documentclass[a4paper,10pt]{article}
\usepackage[margin=20mm]{geometry}
\usepackage{amsmath,amssymb}
\setlength{\parindent}{0pt}
\setlength{\parskip}{4pt}
\raggedright
\begin{document}
"""
LONGEST_DISPLAY = 120
"""A longer sum is set in the running text, where TeX breaks it [characters]."""
NAMES = {
    "|det E|": r"\left|\det E\right|",
    "|det E|^2": r"\left|\det E\right|^2",
    "det": r"\det",
    "gain_v": r"\mathrm{gain}_v",
    "inverse": r"\det\nolimits^{-1}",
}


def to_latex(program: Program) -> str:
    """Return a standalone document: inputs, formulas, steps, results."""
    parts = [HEAD, rf"\section*{{{escaped(program.title)}}}", r"\subsection*{Given}"]
    parts += [_input(q) for q in program.inputs]
    if program.statements:
        parts.append(r"\subsection*{Why}")
    for statement in program.statements:
        parts.append(prose(statement.words) + "\n")
        if statement.left is not None:
            left, right = _math(statement.left), _math(statement.right)
            if isinstance(statement.right, sp.Add) and len(right) > LONGEST_DISPLAY:
                parts.append(f"${left} = {right}$\n")
                continue
            # What a wide matrix equals stands on a line of its own.
            wide = isinstance(statement.left, sp.MatMul) and not _is_short(statement.right)
            shape = ("multline*", r" \\ = ") if wide else ("equation*", " = ")
            body = f"{left}{shape[1]}{right}"
            parts.append(f"\\begin{{{shape[0]}}}\n{body}\n\\end{{{shape[0]}}}\n")
    if program.steps:
        parts.append(r"\subsection*{Steps}")
    parts += [_formula(_math(symbol), value) for symbol, value in program.steps]
    parts.append(r"\subsection*{Result}")
    for o in program.outputs:
        parts.append(f"{prose(o.meaning)} [{_unit(o.unit)}]\n")
        parts += [
            _formula(_label(label), value) for label, value in zip(o.labels, o.values, strict=True)
        ]
    return "\n".join([*parts, r"\end{document}", ""])


def _is_short(column: Expr) -> bool:
    return all(entry.is_Atom for entry in column)


def _input(q: Quantity) -> str:
    shown = ", ".join(_math(s) for s in q.symbols[:3])
    if len(q.symbols) > 3:
        shown += rf", \dots, {_math(q.symbols[-1])}"
    return f"${shown}$: {prose(q.meaning)} [{_unit(q.unit)}]\n"


def _formula(left: str, value: Expr) -> str:
    right = _math(value)
    if r"\frac" in right and len(right) <= LONGEST_DISPLAY:
        left = rf"\displaystyle {left}"
    return f"${left}$\n" if right == left else f"${left} = {right}$\n"


def _label(label: str) -> str:
    return NAMES.get(label) or _math(sp.Symbol(label))


def _unit(unit: str) -> str:
    return "$" + r"\,".join(rf"\mathrm{{{part}}}" for part in unit.split()) + "$"


def _math(value: Expr | None) -> str:
    symbols = value.free_symbols if value is not None else ()
    names = {s: name for s in symbols if (name := _name(s.name))}
    text: str = sp.latex(value, imaginary_unit=r"\mathrm{j}", symbol_names=names)
    return tight(text)


def _name(name: str) -> str | None:
    """Return how a symbol is written that sympy would set as a product of letters."""
    base, _, index = name.partition("_")
    if name in NAMES or not base.isalpha() or sp.latex(sp.Symbol(base)).startswith("\\"):
        return NAMES.get(name)
    if len(base) > 1:
        return rf"\mathrm{{{base}}}" + (rf"_{{{index.replace('_', ' ')}}}" if index else "")
    return rf"{base}_{{\mathrm{{{index}}}}}" if len(index) > 3 and index.isalpha() else None
