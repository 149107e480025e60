# SPDX-License-Identifier: Apache-2.0
"""Programs as C99 functions over double: no dependency but libm, no allocation, no branch.

A step is a named constant, as in the formulas; a program with more operations than a compiler takes
in its stride becomes a table and a loop (:mod:`comcal.symbolic.to_c_table`).

With ``COMCAL_SELF_TEST`` defined the file has a ``main`` that computes one example and compares it
with the numbers the generator found.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from comcal.symbolic.infix import Infix, Notation
from comcal.symbolic.program import Output, Program, Quantity
from comcal.symbolic.real_form import real_form
from comcal.symbolic.samples import sample_inputs
from comcal.symbolic.to_c_table import WIDTH, TableBody, table_body
from comcal.symbolic.to_python import python_function

MOST_OPERATIONS = 4000
"""Up to here a function is written out; gcc -O2 takes about a second for so many."""


def _number(x: float) -> str:
    text = repr(float(x))
    return text if any(mark in text for mark in ".en") else f"{text}.0"


NOTATION = Notation(
    number=_number,
    functions={
        "cos": "cos({})",
        "sin": "sin({})",
        "tan": "tan({})",
        "exp": "exp({})",
        "sqrt": "sqrt({})",
        "Abs": "fabs({})",
    },
)

SELF_TEST = """\
#ifdef COMCAL_SELF_TEST
#include <stdio.h>

static int differs(const double *found, const double *expected, int n)
{{
    int k;
    for (k = 0; k < n; k++)
        if (!(fabs(found[k] - expected[k]) <= 1e-12 * (1.0 + fabs(expected[k]))))
            return 1;
    return 0;
}}

int main(void)
{{
{declared}
    {call}
    if ({failed}) {{
        puts("{name}: FAILED");
        return 1;
    }}
    puts("{name}: ok");
    return 0;
}}
#endif
"""


def to_c(program: Program) -> str:
    """Return a C99 source with one function; lists are flat arrays, row by row."""
    real = real_form(program).only_used()
    names = {
        symbol: f"{q.name}[{k}]" if q.shape else q.name
        for q in real.inputs
        for k, symbol in enumerate(q.symbols)
    }
    infix = Infix(NOTATION, names)
    written = [(symbol.name, infix.write(value)) for symbol, value in real.steps]
    # Every operator stands between two blanks.
    operations = sum(text.count(" ") // 2 for _, text in written)
    table = table_body(real, NOTATION, names) if operations > MOST_OPERATIONS else None
    body = table.lines if table else [f"    const double {x} = {text};" for x, text in written]
    if table:
        infix = Infix(NOTATION, names | table.names)
    signature = _signature(program.name, real.inputs, real.outputs)
    lines = [
        *_comment(program, table),
        "#include <math.h>",
        "",
        f"{signature};",
        "",
        *([*table.before.splitlines(), ""] if table else []),
        signature,
        "{",
        *body,
    ]
    lines += [
        f"    {f'{o.name}[{k}]' if o.is_list else f'*{o.name}'} = {infix.write(value)};"
        for o in real.outputs
        for k, value in enumerate(o.values)
    ]
    return "\n".join([*lines, "}", "", self_test(program, real)])


def self_test(program: Program, real: Program) -> str:
    """Return the ``main`` under ``COMCAL_SELF_TEST``.

    Parameters
    ----------
    program : Program
        Its generated Python function supplies the expected numbers.
    real : Program
        The same in real form: which inputs the C function takes.
    """
    values = sample_inputs(program.inputs)
    found = python_function(program)(**values)
    expected = found if len(program.outputs) > 1 else (found,)
    declared: list[str] = []
    for q in real.inputs:
        value = np.ravel(values[q.name]).tolist()
        if q.shape:
            declared.append(_array(q.name, value))
        else:
            declared.append(f"    const double {q.name} = {_number(value[0])};")
    for o, value in zip(program.outputs, expected, strict=True):
        declared.append(_array(f"expected_{o.name}", np.ravel(value).tolist()))
        declared.append(f"    double {o.name}[{len(o.values)}];")
    arguments = ", ".join([q.name for q in real.inputs] + [o.name for o in program.outputs])
    failed = " || ".join(
        f"differs({o.name}, expected_{o.name}, {len(o.values)})" for o in program.outputs
    )
    return SELF_TEST.format(
        declared="\n".join(declared),
        call=f"{program.name}({arguments});",
        failed=failed,
        name=program.name,
    )


def _array(name: str, values: Sequence[float]) -> str:
    numbers = ", ".join(_number(x) for x in values)
    text = f"static const double {name}[{len(values)}] = {{{numbers}}};"
    return textwrap.fill(text, WIDTH, initial_indent="    ", subsequent_indent="        ")


def _signature(name: str, inputs: Sequence[Quantity], outputs: Sequence[Output]) -> str:
    arguments = [
        f"const double {q.name}[{len(q.symbols)}]" if q.shape else f"double {q.name}"
        for q in inputs
    ]
    arguments += [
        f"double {o.name}[{len(o.values)}]" if o.is_list else f"double *{o.name}" for o in outputs
    ]
    text = f"void {name}({', '.join(arguments)})"
    return textwrap.fill(text, WIDTH, subsequent_indent="    ")


def _comment(program: Program, table: TableBody | None) -> list[str]:
    lines = [f"{program.title}; generated by comcal derive.", ""]
    for q in program.inputs:
        shape = " x ".join(map(str, q.shape))
        lines.append(f"{q.name}{f' ({shape})' if shape else ''}: {q.meaning} [{q.unit}]")
    lines.append("")
    for o in program.outputs:
        shape = f" ({len(o.values)})" if o.is_list else ""
        lines.append(f"{o.name}{shape}: {o.meaning} [{o.unit}]")
    if table:
        lines += ["", f"Needs {-(-table.stack // 1024)} KiB of stack."]
    wrapped = [part for line in lines for part in textwrap.wrap(line, WIDTH - 3) or [""]]
    return ["/*", *(f" * {line}".rstrip() for line in wrapped), " */"]
