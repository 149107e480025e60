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
from comcal.symbolic.nullspace import spatial_program
from comcal.symbolic.one_joint import one_joint_program
from comcal.symbolic.program import Program, Steps
from comcal.symbolic.samples import sample_inputs
from comcal.symbolic.sigma import sigma_program
from comcal.symbolic.spatial import chain_from_axes
from comcal.symbolic.system import free_angles, system_of
from comcal.symbolic.to_c import to_c
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
