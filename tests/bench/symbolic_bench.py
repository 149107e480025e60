# SPDX-License-Identifier: Apache-2.0
"""How long derivations take and how fast the generated code is, beside their limits.

    python tests/bench/symbolic_bench.py [--naive SECONDS]

sympy's expanded Cramer's rule runs beside it in a child process, ended after that many seconds (60;
0 leaves it out). The exit code is 1 if a limit is not met. Times are the best of several, taken in
turns where two are compared, so that both see the same load.
"""

from __future__ import annotations

import argparse
import ctypes
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.synchronize import Event
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
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")


@dataclass(frozen=True)
class Row:
    """One line of the table: a time, and what it has to stay below."""

    what: str
    seconds: float
    limit: float
    beside: str = ""

    def __str__(self) -> str:
        verdict = "ok" if self.is_met else "TOO SLOW"
        found, limit = (in_units(x) for x in (self.seconds, self.limit))
        return f"{self.what:44} {found:>10} {limit:>10}  {verdict:8}  {self.beside}".rstrip()

    @property
    def is_met(self) -> bool:
        return self.seconds < self.limit


def in_units(seconds: float) -> str:
    return f"{seconds:.3f} s" if seconds > 1e-3 else f"{seconds * 1e6:.2f} us"


def best(call: Callable[[], object], repeat: int) -> float:
    """Shortest of *repeat* calls [s]."""
    times: list[float] = []
    for _ in range(repeat):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def free(n: int) -> Program:
    angles, phi = free_angles(n)
    return cramer_program(system_of(planar_chain(n), angles, [phi]))


def one_joint(n: int) -> Program:
    return one_joint_program(planar_chain(n))


# --- sympy as one would write it first --------------------------------------------------------


def naive(n: int, done: Event) -> None:
    """The real 2n x 2n Cramer's rule with sympy's determinants."""
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
    seconds = time.perf_counter() - start
    return f"naive sympy {seconds:.2f} s" if done.is_set() else f"naive sympy > {limit:g} s, ended"


# --- how long derivations take ----------------------------------------------------------------


def derivations(limit: float) -> Iterator[Row]:
    free(2)  # the first derivation pays for sympy's own start
    for n, wanted in ((3, 0.2), (6, 1.0), (10, 5.0)):
        beside = ""
        if limit:
            beside = naive_seconds(n, limit) if n == 3 else "naive sympy not tried: n = 3 is enough"
        for language, written in (("Python", to_python), ("C", to_c)):
            seconds = best(lambda n=n, written=written: written(free(n)), 3)
            yield Row(f"free configurations, n = {n}, {language}", seconds, wanted, beside)
            beside = ""
    for language, written in (("Python", to_python), ("C", to_c)):
        seconds = best(lambda written=written: written(one_joint(50)), 3)
        yield Row(f"one joint at a time, n = 50, {language}", seconds, 1.0)


def compilations(folder: Path) -> Iterator[Row]:
    for n in (6, 10):
        source = folder / f"free_{n}.c"
        source.write_text(to_c(free(n)))
        command = ["gcc", *STRICT, "-c", source, "-o", folder / "made.o"]
        seconds = best(lambda command=command: subprocess.run(command, check=True), 2)
        yield Row(f"gcc -O2, free configurations, n = {n}", seconds, 5.0)


# --- how fast the generated code is -----------------------------------------------------------


def by_numpy(X, Z, phi, m, L, m_u, r_u, l_u, U):
    """Build and solve the system as a numpy user does."""
    E = np.exp(1j * phi)
    at = U + np.concatenate([np.zeros((*E.shape[:-1], 1)), np.cumsum(L * E[..., :-1], -1)], -1)
    K = (m_u + m.sum()) * (Z + 1j * X) - m_u * (l_u + 1j * r_u) - at @ m
    w = np.linalg.solve(E, K[..., None])[..., 0] / m
    return w.imag, w.real


def c_seconds(program: Program, inputs: dict[str, np.ndarray], folder: Path) -> float:
    """Time per call of the compiled C, in a loop inside C."""
    loop = (
        f"{to_c(program)}\nvoid repeat(int count, const double *X, const double *Z, "
        "const double *phi, const double *m, const double *L, double m_u, double r_u, double l_u, "
        "double U, double *r, double *l, double *d)\n{ int k; for (k = 0; k < count; k++) "
        "link_coms(X, Z, phi, m, L, m_u, r_u, l_u, U + 1e-9 * k, r, l, d); }\n"
    )
    source, library = folder / "b.c", folder / f"b{len(inputs['m'])}.so"
    source.write_text(loop)
    options = ["-std=c99", "-O2", "-shared", "-fPIC"]
    subprocess.run(["gcc", *options, source, "-o", library, "-lm"], check=True)
    repeat = ctypes.CDLL(str(library)).repeat
    n = len(inputs["m"])
    arrays = [np.ascontiguousarray(inputs[k], float) for k in ("X", "Z", "phi", "m", "L")]
    outputs = [np.empty(n), np.empty(n), np.empty(1)]
    pointer = ctypes.POINTER(ctypes.c_double)
    numbers = [ctypes.c_double(float(inputs[k])) for k in ("m_u", "r_u", "l_u", "U")]
    arguments = [a.ctypes.data_as(pointer) for a in arrays]
    results = [a.ctypes.data_as(pointer) for a in outputs]
    seconds = best(lambda: repeat(BATCH, *arguments, *numbers, *results), 20) / BATCH
    wanted = np.concatenate(by_numpy(**{**inputs, "U": inputs["U"] + 1e-9 * (BATCH - 1)}))
    np.testing.assert_allclose(np.concatenate(outputs[:2]), wanted, atol=1e-11)
    return seconds


def speeds(n: int, folder: Path, *, has_gcc: bool) -> Iterator[Row]:
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
    if has_gcc:
        by_hand = best(lambda: by_numpy(**one), 500)
        yield Row(f"n = {n}: C per call, against numpy", c_seconds(program, one, folder), by_hand)
    turns = [
        (best(lambda: function(**many), 1), best(lambda: by_numpy(**many), 1)) for _ in range(100)
    ]
    made, by_hand = (min(t) / BATCH for t in zip(*turns, strict=True))
    slower = sum(ours > theirs for ours, theirs in turns)
    beside = f"slower in {slower} of {len(turns)} turns"
    yield Row(f"n = {n}: numpy code per pose, against numpy", made, by_hand, beside)


def rows(limit: float, folder: Path) -> Iterator[Row]:
    has_gcc = shutil.which("gcc") is not None
    yield from derivations(limit)
    if has_gcc:
        yield from compilations(folder)
    yield from speeds(6, folder, has_gcc=has_gcc)
    if not has_gcc:
        print("no gcc here: C was neither compiled nor run")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--naive", type=float, default=60.0, metavar="SECONDS")
    limit = parser.parse_args().naive
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, numpy {np.__version__}")
    print(f"{'':44} {'found':>10} {'limit':>10}")
    is_met = True
    with tempfile.TemporaryDirectory() as folder:
        for row in rows(limit, Path(folder)):
            print(row, flush=True)
            is_met &= row.is_met
    return 0 if is_met else 1


if __name__ == "__main__":
    sys.exit(main())
