# SPDX-License-Identifier: Apache-2.0
"""Rules about files: what they start with, how long they are, what they never do."""

from __future__ import annotations

import ast
from pathlib import Path

SPDX = "# SPDX-License-Identifier: Apache-2.0"
LONGEST = 400


def test_every_file_starts_with_the_licence_line(all_files: list[Path]) -> None:
    without = [f for f in all_files if not f.read_text("utf-8").startswith(SPDX + "\n")]
    assert not without


def test_no_module_is_longer_than_400_lines(all_files: list[Path]) -> None:
    lengths = {str(f): len(f.read_text("utf-8").splitlines()) for f in all_files}
    assert not {f: n for f, n in lengths.items() if n > LONGEST}


def test_library_neither_asserts_nor_prints(library_files: list[Path]) -> None:
    found = [
        f"{file}:{node.lineno}"
        for file in library_files
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Assert)
        or (isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print")
    ]
    assert not found


def test_library_draws_no_random_number_without_a_seed(library_files: list[Path]) -> None:
    """``default_rng()`` without an argument, and the module-level functions, hide their seed."""
    hidden = {"seed", "rand", "randn", "random", "normal", "uniform", "choice", "shuffle"}
    found = [
        f"{file}:{node.lineno}"
        for file in library_files
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Call)
        and (name := ast.unparse(node.func)).startswith(("np.random.", "numpy.random.", "random."))
        and (name.rsplit(".", 1)[1] in hidden or (name.endswith("default_rng") and not node.args))
    ]
    assert not found
