# SPDX-License-Identifier: Apache-2.0
"""How long derivations take and how fast the generated code is; run by hand, prints a table.

    python tests/bench/symbolic_bench.py [--naive SECONDS]

``--naive`` runs sympy's expanded Cramer's rule beside it, stopped after that many seconds.
"""

from __future__ import annotations

import argparse
import ctypes
import multiprocessing
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import sympy as sp

from comcal.symbolic.chain import planar_chain
from comcal.symbolic.cramer import cramer_program
from comcal.symbolic.one_joint import one_joint_program
from comcal.symbolic.program import Program
from comcal.symbolic.samples import sample_inputs
from comcal.symbolic.system import free_angles, system_of
from comcal.symbolic.to_c import to_c
from comcal.symbolic.to_python import python_function, to_python

BATCH = 1000


def free(n: int) -> Program:
    angles, phi = free_angles(n)
    return cramer_program(system_of(planar_chain(n), angles, [phi]))


def naive(n: int, done: multiprocessing.Event) -> None:
    """The real 2n x 2n Cramer's rule with sympy's determinants, as one would write it first."""
    phi = sp.symbols(f"phi:{n * n}", real=True)
    m, a = sp.symbols(f"m:{n}"), sp.Matrix(sp.symbols(f"a:{2 * n}"))
    rows: list[list[sp.Expr]] = []
    for i in range(n):
        x: list[sp.Expr] = []
        z: list[sp.Expr] = []
        for v in range(n):
            s, c = sp.sin(phi[i * n + v]), sp.cos(phi[i * n + v])
            x += [m[v] * c, m[v] * s]
            z += [-m[v] * s, m[v] * c]
        rows += [x, z]
    A = sp.Matrix(rows)
    det = A.det()
    for column in range(2 * n):
        replaced = A.copy()
        replaced[:, column] = a
        replaced.det() / det
    done.set()


def naive_seconds(n: int, limit: float) -> str:
    done = multiprocessing.Event()
    process = multiprocessing.Process(target=naive, args=(n, done))
    start = time.perf_counter()
    process.start()
    process.join(limit)
    if process.is_alive():
        process.kill()
        process.join()
    return f"{time.perf_counter() - start:.2f}" if done.is_set() else f"> {limit:.0f}"


def best(call: Callable[[], object], repeat: int) -> float:
    """Shortest of *repeat* calls [s]."""
    times: list[float] = []
    for _ in range(repeat):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def by_numpy(X, Z, phi, m, L, m_u, r_u, l_u, U):
    """Build and solve the system as a numpy user does."""
    E = np.exp(1j * phi)
    at = U + np.concatenate([np.zeros((*E.shape[:-1], 1)), np.cumsum(L * E[..., :-1], -1)], -1)
    K = (m_u + m.sum()) * (Z + 1j * X) - m_u * (l_u + 1j * r_u) - at @ m
    w = np.linalg.solve(E, K[..., None])[..., 0] / m
    return w.imag, w.real


def c_seconds(program: Program, inputs: dict[str, np.ndarray], folder: Path) -> float | None:
    """Time per call of the compiled C, in a loop inside C."""
    if shutil.which("gcc") is None:
        return None
    loop = (
        f"{to_c(program)}\nvoid repeat(int count, const double *X, const double *Z, "
        "const double *phi, const double *m, const double *L, double m_u, double r_u, double l_u, "
        "double U, double *r, double *l, double *d)\n{ int k; for (k = 0; k < count; k++) "
        "link_coms(X, Z, phi, m, L, m_u, r_u, l_u, U + 1e-9 * k, r, l, d); }\n"
    )
    (folder / "b.c").write_text(loop)
    library = folder / "b.so"
    options = ["-std=c99", "-O2", "-shared", "-fPIC"]
    subprocess.run(["gcc", *options, folder / "b.c", "-o", library, "-lm"], check=True)
    repeat = ctypes.CDLL(str(library)).repeat
    n = len(inputs["m"])
    arrays = [np.ascontiguousarray(inputs[k], float) for k in ("X", "Z", "phi", "m", "L")]
    outputs = [np.empty(n), np.empty(n), np.empty(1)]
    pointer = ctypes.POINTER(ctypes.c_double)
    numbers = [ctypes.c_double(float(inputs[k])) for k in ("m_u", "r_u", "l_u", "U")]
    arguments = [a.ctypes.data_as(pointer) for a in arrays]
    results = [a.ctypes.data_as(pointer) for a in outputs]
    return best(lambda: repeat(BATCH, *arguments, *numbers, *results), 20) / BATCH


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--naive", type=float, default=0.0)
    limit = parser.parse_args().naive
    free(2)  # the first derivation pays for sympy's own start
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; seconds")
    for n, wanted in ((2, None), (3, 0.2), (6, 1.0), (10, 5.0)):
        code = best(lambda n=n: to_python(free(n)), 1)
        in_c = best(lambda n=n: to_c(free(n)), 1)
        text = f"free n = {n:2}: Python {code:.3f}, C {in_c:.3f}, wanted {wanted}"
        if limit and n <= 3:
            text += f", naive sympy {naive_seconds(n, limit)}"
        print(text)
    code = best(lambda: to_python(one_joint_program(planar_chain(50))), 1)
    in_c = best(lambda: to_c(one_joint_program(planar_chain(50))), 1)
    print(f"one joint n = 50: Python {code:.3f}, C {in_c:.3f}, wanted 1.0")
    for n in (2, 3, 4, 6):
        program = free(n)
        function = python_function(program)
        one = sample_inputs(program.inputs)
        rng = np.random.default_rng(n)
        many = {
            **one,
            "X": rng.normal(size=(BATCH, n)),
            "Z": rng.normal(size=(BATCH, n)),
            "phi": rng.uniform(-1.5, 1.5, (BATCH, n, n)),
        }
        numpy_one = best(lambda one=one: by_numpy(**one), 200)
        # Taken in turns, so that both see the same load.
        turns = [
            (
                best(lambda many=many: by_numpy(**many), 5),
                best(lambda f=function, many=many: f(**many), 5),
            )
            for _ in range(20)
        ]
        numpy_many, made_many = (min(t) / BATCH for t in zip(*turns, strict=True))
        with tempfile.TemporaryDirectory() as folder:
            made_c = c_seconds(program, one, Path(folder))
        in_c = "no gcc" if made_c is None else f"{made_c * 1e6:.2f}"
        print(
            f"n = {n}, us: C {in_c} per call, numpy {numpy_one * 1e6:.1f} per call; "
            f"generated numpy {made_many * 1e6:.2f} per pose, numpy solve {numpy_many * 1e6:.2f}"
        )


if __name__ == "__main__":
    main()
