# SPDX-License-Identifier: Apache-2.0
"""Generated Python and C compute the same numbers; LaTeX is well formed."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from comcal.symbolic.chain import planar_chain
from comcal.symbolic.coefficients import coefficients_program, total_com_program
from comcal.symbolic.cofactors import free_factors
from comcal.symbolic.cramer import cramer_program
from comcal.symbolic.infix import Infix
from comcal.symbolic.latex_text import prose, tight
from comcal.symbolic.nullspace import spatial_program
from comcal.symbolic.one_joint import one_joint_program
from comcal.symbolic.program import Output, Program, Steps, scalar
from comcal.symbolic.samples import sample_inputs
from comcal.symbolic.sigma import sigma_program
from comcal.symbolic.spatial import chain_from_axes
from comcal.symbolic.system import free_angles, system_of
from comcal.symbolic.to_c import MOST_OPERATIONS, to_c
from comcal.symbolic.to_c import NOTATION as C_NOTATION
from comcal.symbolic.to_c_table import table_body
from comcal.symbolic.to_latex import to_latex
from comcal.symbolic.to_python import NOTATION, python_function, to_python
from comcal.symbolic.to_text import to_text

GCC = shutil.which("gcc")
LATEX = shutil.which("pdflatex")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")


def free(n: int) -> Program:
    angles, phi = free_angles(n)
    return cramer_program(system_of(planar_chain(n), angles, [phi]))


def free_sigma(n: int) -> Program:
    angles, phi = free_angles(n)
    system, steps = system_of(planar_chain(n), angles, [phi]), Steps()
    return sigma_program(system, free_factors(system, steps), steps)


def spatial() -> Program:
    axes = [[0, 0, 1], [0, 1, 0], [1, 2, 2]]
    return spatial_program(chain_from_axes(axes, [[0.1, 0.2, 0.3]] * 3, [False, True, False]))


MAKERS: dict[str, Callable[[], Program]] = {
    "coefficients": coefficients_program,
    "total_com": total_com_program,
    "one_link": lambda: one_joint_program(planar_chain(1)),
    "one_joint_4": lambda: one_joint_program(planar_chain(4, offsets=True)),
    "free_2": lambda: free(2),
    "free_5": lambda: free(5),
    "sigma_3": lambda: free_sigma(3),
    "spatial": spatial,
}


@pytest.fixture(scope="module", params=MAKERS)
def program(request: pytest.FixtureRequest) -> Program:
    return MAKERS[request.param]()


def compiled(source: str, folder: Path, *options: str) -> Path:
    if GCC is None:
        pytest.skip("NO gcc HERE: THE GENERATED C WAS NOT COMPILED")
    (folder / "made.c").write_text(source)
    made = folder / "made"
    command = [GCC, *STRICT, *options, str(folder / "made.c"), "-o", str(made), "-lm"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    return made


def test_generated_c_passes_its_own_test(program: Program, tmp_path: Path) -> None:
    made = compiled(to_c(program), tmp_path, "-DCOMCAL_SELF_TEST")
    run = subprocess.run([made], capture_output=True, text=True, timeout=20)
    assert (run.returncode, run.stdout) == (0, f"{program.name}: ok\n")


@pytest.mark.parametrize("n", [7, 8, 9])
def test_large_c_is_a_table_that_compiles_as_fast_as_any(n: int, tmp_path: Path) -> None:
    """Written out, ten links take gcc more than a minute; the sums are the same either way."""
    source = to_c(free(n))
    assert ("_pairs[" in source) == (n > 7)
    library = source.split("#ifdef COMCAL_SELF_TEST")[0]
    assert len(re.findall(r" [-+*/] ", library)) < MOST_OPERATIONS
    made = compiled(source, tmp_path, "-O1", "-DCOMCAL_SELF_TEST")
    assert subprocess.run([made], capture_output=True, timeout=20).returncode == 0


def test_the_self_test_of_a_table_sees_a_wrong_index(tmp_path: Path) -> None:
    source = to_c(free(8))
    wrong = re.sub(r"(_pairs\[\d+\] = \{\n    \d+, )(\d+)", r"\g<1>0", source)
    assert wrong != source
    made = compiled(wrong, tmp_path, "-DCOMCAL_SELF_TEST")
    assert subprocess.run([made], capture_output=True, timeout=20).returncode == 1


def test_a_table_adds_subtracts_and_squares_as_the_formula_does(tmp_path: Path) -> None:
    """Of sums of products of steps only; all else stays an assignment."""
    x, y = scalar("x", "", "m"), scalar("y", "", "m")
    steps = Steps()
    a = steps.let("a", x.symbols[0] + 2, real=True)
    b = steps.let("b", sp.cos(y.symbols[0]), real=True)
    squares = steps.let("squares", a**2 - b**2 + a * b, real=True)
    scaled = steps.let("scaled", 3 * a * b - squares, real=True)
    mixed = steps.let("mixed", -squares * scaled - a * scaled, real=True)
    output = Output("z", ("z",), (mixed,), False, "", "m")
    program = Program("made", "made", (x, y), tuple(steps.done), (output,))
    body = table_body(program, C_NOTATION, {s: s.name for q in (x, y) for s in q.symbols})
    assert body is not None
    assert [
        re.search(r"sums\(t, (\d), (\d)", line).groups() for line in body.lines if "sums(" in line
    ] == [
        ("2", "3"),
        ("4", "5"),
    ]
    (tmp_path / "made.c").write_text(
        "#include <math.h>\n#include <stdio.h>\n"
        + body.before
        + "\nint main(void)\n{\n    const double x = 0.3, y = 0.7;\n"
        + "\n".join(body.lines)
        + f'\n    printf("%.17g", {body.names[mixed]});\n    return 0;\n}}\n'
    )
    made = compiled((tmp_path / "made.c").read_text(), tmp_path)
    found = float(subprocess.run([made], capture_output=True, timeout=20, text=True).stdout)
    assert found == pytest.approx(float(python_function(program)(x=0.3, y=0.7)), rel=1e-14)


def test_the_self_test_sees_a_wrong_sign(tmp_path: Path) -> None:
    source = to_c(free(2))
    wrong = source.replace("= f_c_c_re - f_b_c_re", "= f_c_c_re + f_b_c_re")
    assert wrong != source
    made = compiled(wrong, tmp_path, "-DCOMCAL_SELF_TEST")
    assert subprocess.run([made], capture_output=True, timeout=20).returncode == 1


def test_generated_c_needs_nothing_but_libm(program: Program) -> None:
    library, test = to_c(program).split("#ifdef COMCAL_SELF_TEST")
    assert re.findall(r"#include <(.*)>", library) == ["math.h"]
    assert re.findall(r"#include <(.*)>", test) == ["stdio.h"]


def test_generated_python_is_batched_over_leading_axes(program: Program) -> None:
    function = python_function(program)
    one = sample_inputs(program.inputs)
    shift = np.array([0.0, 0.01, 0.02]).reshape(3, 1)
    many = {name: value + shift.reshape(3, *[1] * value.ndim) for name, value in one.items()}
    together = function(**many)
    for k, step in enumerate(shift[:, 0]):
        alone = function(**{name: value + step for name, value in one.items()})
        for a, b in zip(together, alone, strict=True):
            assert np.broadcast_to(a, (3, *np.shape(b)))[k] == pytest.approx(b, rel=1e-13)


def test_generated_turns_are_exact_at_every_angle() -> None:
    function = python_function(free(2))
    code = function.__globals__["_turn"]
    quarter = np.arange(-8, 9) * (np.pi / 2)
    angle = np.concatenate([quarter, np.nextafter(quarter, 9), np.linspace(-20, 20, 100_001)])
    assert np.max(np.abs(code(angle) - np.exp(1j * angle))) < 1e-15


def test_generated_python_stands_alone(program: Program) -> None:
    assert re.findall(r"^import .*|^from .*", to_python(program), re.MULTILINE) == [
        "import numpy as np"
    ]


def test_latex_is_balanced_and_its_names_are_escaped(program: Program) -> None:
    text = to_latex(program)
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
    assert text.count(r"\left") == text.count(r"\right")
    assert re.findall(r"\\(?:begin|end)\{(\w+)\}", text).count("document") == 2
    displayed = r"\\begin\{(equation|multline)\*\}.*?\\end\{\1\*\}"
    outside = re.sub(rf"{displayed}|\$[^$]*\$", "", text, flags=re.DOTALL)
    assert not re.search(r"(?<!\\)[_^&#]", outside)


def test_latex_compiles_and_fits_the_page(program: Program, tmp_path: Path) -> None:
    if LATEX is None:
        pytest.skip("no pdflatex here: the generated LaTeX was not compiled")
    (tmp_path / "made.tex").write_text(to_latex(program))
    command = [LATEX, "-interaction=nonstopmode", "-halt-on-error", "made.tex"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stdout[-2000:]
    assert "Overfull" not in run.stdout


def test_text_names_every_input_and_result(program: Program) -> None:
    text = to_text(program)
    for q in (*program.inputs, *program.outputs):
        assert re.search(rf"^  {q.name}\b.*: ", text, re.MULTILINE)


x, y, z = sp.symbols("x y z", real=True)


@pytest.mark.parametrize(
    "value",
    [
        x - (y - z),
        -(x + y) * z,
        x / (y * z) - 1 / x,
        -x / (y + z),
        sp.Rational(-2, 3) * x * y**2 / z**3,
        sp.sqrt(x**2 + y**2) / sp.sqrt(z),
        (x + y) ** 2 / (x - 3) ** 2,
        sp.Float(-0.25) * (x - sp.Rational(1, 3)),
        x ** sp.Integer(-1) * sp.Float("1e-300") + sp.Float("1e22"),
    ],
)
def test_infix_means_what_the_expression_means(value: sp.Expr) -> None:
    text = Infix(NOTATION, {}).write(value)
    numbers = {"x": 0.7, "y": 1.3, "z": 2.1}
    found = eval(text, {"np": np}, dict(numbers))
    right = value.subs({sp.Symbol(k, real=True): v for k, v in numbers.items()})
    assert found == pytest.approx(float(right), rel=1e-13)


def test_symbols_in_sentences_are_set_as_formulas_and_names_of_links_are_not() -> None:
    assert prose("S_(n+1) of theta_v, m_b^2 & l_knee about tau, s_v_i.") == (
        r"$S_{n+1}$ of $\theta_{v}$, $m_{b}^2$ \& l\_knee about $\tau$, $s_{vi}$."
    )
    assert prose("z + I x: 50 %") == r"$z + \mathrm{j}x$: 50 \%"


def test_parentheses_of_functions_are_tight_and_match() -> None:
    value = sp.sin(x + sp.cos(y / 2)) ** 2 * (x + 1) / (y * (z + sp.sin(x)))
    text = tight(sp.latex(value))
    assert r"\sin^{2}\bigl(" in text
    assert not re.search(r"\\left|\\right|(?:sin|cos)(?:\^\{2\})?\{", text)
    assert text.count("(") == text.count(")")
    assert text.count("{") == text.count("}")
