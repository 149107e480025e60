# SPDX-License-Identifier: Apache-2.0
r"""What LaTeX prints between formulas: words with the symbols in them set as mathematics."""

from __future__ import annotations

import re

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
    "|": r"\textbar{}",
}
GREEK = ("alpha", "beta", "gamma", "delta", "theta", "phi", "psi", "tau", "sigma")
PHRASES = {
    "z + I x": r"$z + \mathrm{j}x$",
    "e^(I sum phi_i1)": r"$e^{\mathrm{j} \sum_i \phi_{i1}}$",
    "|det E|": r"$|\det E|$",
    "det E": r"$\det E$",
    "det D": r"$\det D$",
    "E G = K": r"$E G = K$",
    "1 .. n": r"$1, \dots, n$",
}
"""Pieces of statements that are more than one symbol."""
SYMBOL = re.compile(
    rf"(?<![\w/.-])(?:(?P<base>{'|'.join(GREEK)}|gain|[A-Za-z])_(?P<sub>\(n\+1\)|[A-Za-z0-9]{{1,2}})"
    rf"(?P<second>_[A-Za-z0-9])?(?P<square>\^2)?|(?P<alone>{'|'.join(GREEK)}))(?![\w/]|\.\w)"
)
"""A letter with a short index, or a Greek one; names of links and joints are longer."""


def escaped(text: str) -> str:
    """Return *text* as LaTeX prints it literally."""
    return "".join(SPECIAL.get(character, character) for character in text)


def prose(text: str) -> str:
    r"""Return a sentence as LaTeX, its symbols as mathematics.

    Parameters
    ----------
    text : str

    Examples
    --------
    >>> prose("bent by theta_v, link l_knee")
    'bent by $\\theta_{v}$, link l\\_knee'
    """
    known = "|".join(map(re.escape, PHRASES))
    parts = re.split(f"({known})", text)
    return "".join(PHRASES.get(part) or _with_symbols(part) for part in parts)


def _with_symbols(text: str) -> str:
    done, out = 0, ""
    for found in SYMBOL.finditer(text):
        out += escaped(text[done : found.start()]) + _symbol(found)
        done = found.end()
    return out + escaped(text[done:])


def _symbol(found: re.Match[str]) -> str:
    if found["alone"]:
        return rf"$\{found['alone']}$"
    base = found["base"]
    if base in GREEK:
        base = rf"\{base}"
    elif len(base) > 1:
        base = rf"\mathrm{{{base}}}"
    index = found["sub"].strip("()") + (found["second"] or "").replace("_", "")
    return f"${base}_{{{index}}}{found['square'] or ''}$"


def tight(text: str) -> str:
    r"""Return a formula of sympy's without the space between a function and its parenthesis.

    sympy writes ``\sin{\left(x \right)}``, whose braces make TeX set a space; and what stands
    between ``\left`` and ``\right`` is never broken over lines.

    Parameters
    ----------
    text : str
    """
    opened = re.compile(r"(\\(?:sin|cos|tan|operatorname\{\w+\}))(\^\{\d+\})?\{\\left\(")
    while found := opened.search(text):
        depth, end = 1, found.end()
        while depth:
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        inside = text[found.end() : end - 1].removesuffix(r"\right)").rstrip()
        head = found[1] + (found[2] or "")
        left, right = (r"\bigl(", r"\bigr)") if r"\frac" in inside else ("(", ")")
        text = f"{text[: found.start()]}{head}{left}{inside}{right}{text[end:]}"
    return text.replace(r"\left(", "(").replace(r" \right)", ")").replace(r"\right)", ")")
