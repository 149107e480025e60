# SPDX-License-Identifier: Apache-2.0
r"""Programs as a LaTeX document that needs amsmath and amssymb only.

Steps are set as inline formulas, one a paragraph: TeX then breaks long sums between their terms.
"""

from __future__ import annotations

from comcal.symbolic.algebra import Expr, sp
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
SPECIAL = {
    "\\": r"\textbackslash{}",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "&": r"\&",
    "%": r"\%",
    "#": r"\#",
    "$": r"\$",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
}
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
        parts.append(escaped(statement.words) + "\n")
        if statement.left is not None:
            left, right = _math(statement.left), _math(statement.right)
            if isinstance(statement.right, sp.Add) and len(right) > LONGEST_DISPLAY:
                parts.append(f"${left} = {right}$\n")
                continue
            # Matrices are wide: what they equal stands on a line of its own.
            wide = isinstance(statement.left, sp.MatMul)
            shape = ("multline*", r" \\ = ") if wide else ("equation*", " = ")
            body = f"{left}{shape[1]}{right}"
            parts.append(f"\\begin{{{shape[0]}}}\n{body}\n\\end{{{shape[0]}}}\n")
    if program.steps:
        parts.append(r"\subsection*{Steps}")
    parts += [_formula(_math(symbol), value) for symbol, value in program.steps]
    parts.append(r"\subsection*{Result}")
    for o in program.outputs:
        parts.append(f"{escaped(o.meaning)} [{_unit(o.unit)}]\n")
        parts += [
            _formula(_label(label), value) for label, value in zip(o.labels, o.values, strict=True)
        ]
    return "\n".join([*parts, r"\end{document}", ""])


def escaped(text: str) -> str:
    """Return *text* as LaTeX prints it literally."""
    return "".join(SPECIAL.get(character, character) for character in text)


def _input(q: Quantity) -> str:
    shown = ", ".join(_math(s) for s in q.symbols[:3])
    if len(q.symbols) > 3:
        shown += rf", \dots, {_math(q.symbols[-1])}"
    return f"${shown}$: {escaped(q.meaning)} [{_unit(q.unit)}]\n"


def _formula(left: str, value: Expr) -> str:
    return f"${left} = {_math(value)}$\n"


def _label(label: str) -> str:
    return NAMES.get(label) or _math(sp.Symbol(label))


def _unit(unit: str) -> str:
    return "$" + r"\,".join(rf"\mathrm{{{part}}}" for part in unit.split()) + "$"


def _math(value: Expr | None) -> str:
    names = {s: NAMES[s.name] for s in value.free_symbols if s.name in NAMES} if value else {}
    text: str = sp.latex(value, imaginary_unit=r"\mathrm{j}", symbol_names=names)
    # Inline formulas break only outside of \left \right.
    return text.replace(r"\left(", "(").replace(r"\right)", ")")
