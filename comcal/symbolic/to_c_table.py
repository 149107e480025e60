# SPDX-License-Identifier: Apache-2.0
"""The body of a large C function: sums of products as a table that one small loop works off.

Compilers take minutes over a function with ten thousand operations on thousands of variables.
Nearly all of the steps of Cramer's rule for many links are minors, sums of products of two earlier
steps each. Those are written as pairs of indices into one array that holds every step; the few
others stay assignments.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from comcal.symbolic.algebra import Expr, Symbol, sp
from comcal.symbolic.infix import Infix, Notation
from comcal.symbolic.program import Program

WIDTH = 96
MOST_STEPS = 1 << 16
"""What an unsigned short can number."""

SUMS = """\
/* Each step: how many products to add, their pairs of factors; how many to subtract, theirs. */
static const unsigned short {name}_pairs[{size}] = {{
{numbers}
}};

/* Fill t[first .. last - 1], each with a sum of products of earlier entries; return the rest. */
static const unsigned short *{name}_sums(double *t, int first, int last, const unsigned short *p)
{{
    int k, n;
    for (k = first; k < last; k++) {{
        double sum = 0.0;
        for (n = *p++; n > 0; n--, p += 2)
            sum += t[p[0]] * t[p[1]];
        for (n = *p++; n > 0; n--, p += 2)
            sum -= t[p[0]] * t[p[1]];
        t[k] = sum;
    }}
    return p;
}}
"""


@dataclass(frozen=True)
class TableBody:
    """C text in place of one assignment per step.

    Parameters
    ----------
    before : str
        Table and loop, to stand before the function.
    lines : list of str
        Of the function's body, up to the outputs.
    names : dict
        How each step is written after them.
    stack : int
        Size of the array on the stack [bytes].
    """

    before: str
    lines: list[str]
    names: dict[Symbol, str]
    stack: int


def table_body(real: Program, notation: Notation, names: Mapping[Symbol, str]) -> TableBody | None:
    """Return the steps of a large program as table and loop; None where there is nothing to loop.

    Parameters
    ----------
    real : Program
        In real form.
    notation : Notation
        Of C.
    names : mapping
        How the inputs are written.
    """
    place = {symbol: k for k, (symbol, _) in enumerate(real.steps)}
    pairs = [_pairs(value, place) for _, value in real.steps]
    if len(place) > MOST_STEPS or not any(pairs):
        return None
    steps = {symbol: f"t[{k}]" for symbol, k in place.items()}
    infix = Infix(notation, {**names, **steps})
    table = [number for found in pairs if found for number in found]
    lines = [
        f"    double t[{len(place)}];",
        f"    const unsigned short *p = {real.name}_pairs;",
    ]
    for in_table, group in groupby(range(len(pairs)), key=lambda k: pairs[k] is not None):
        run = list(group)
        if in_table:
            words = f"{real.steps[run[0]][0]} .. {real.steps[run[-1]][0]}"
            lines.append(f"    /* {words} */")
            lines.append(f"    p = {real.name}_sums(t, {run[0]}, {run[-1] + 1}, p);")
            continue
        for k in run:
            symbol, value = real.steps[k]
            lines.append(f"    t[{k}] = {infix.write(value)}; /* {symbol.name} */")
    # The last call's answer is not needed.
    last = max(i for i, line in enumerate(lines) if line.startswith("    p = "))
    lines[last] = f"    (void){lines[last].removeprefix('    p = ')}"
    numbers = textwrap.fill(
        ", ".join(map(str, table)), WIDTH, initial_indent="    ", subsequent_indent="    "
    )
    before = SUMS.format(name=real.name, size=len(table), numbers=numbers)
    return TableBody(before, lines, steps, 8 * len(place))


def _pairs(value: Expr, place: Mapping[Symbol, int]) -> list[int] | None:
    """Return a sum of products of two steps each as numbers, None where it is something else."""
    if not value.is_Add:
        return None
    added: list[int] = []
    subtracted: list[int] = []
    for term in value.args:
        factors = _factors(term)
        negative = bool(factors) and factors[0] == -1
        if negative:
            factors = factors[1:]
        if len(factors) != 2 or any(factor not in place for factor in factors):
            return None
        (subtracted if negative else added).extend(place[factor] for factor in factors)
    return [len(added) // 2, *added, len(subtracted) // 2, *subtracted]


def _factors(term: Expr) -> Sequence[Expr]:
    """Return the factors of a term, a square as two of them."""
    factors: list[Expr] = []
    for factor in sp.Mul.make_args(term):
        base, exponent = factor.as_base_exp()
        factors += [base, base] if exponent == 2 else [factor]
    return factors
