# SPDX-License-Identifier: Apache-2.0
"""What a docstring documents is what the function takes; read from the source, engines or not."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
Function = ast.FunctionDef | ast.AsyncFunctionDef
NEEDS_WORDS = re.compile(r"\bArray\b|\bArrayLike\b|\bNDArray\b|\bfloat\b")


def documented_parameters(docstring: str) -> list[str] | None:
    """Return the names in the Parameters section, in order; None when there is no such section."""
    lines = docstring.splitlines()
    try:
        start = next(
            i
            for i, line in enumerate(lines[:-1])
            if line.strip() == "Parameters" and set(lines[i + 1].strip()) == {"-"}
        )
    except StopIteration:
        return None
    names: list[str] = []
    indent = len(lines[start]) - len(lines[start].lstrip())
    for i, line in enumerate(lines[start + 2 :], start + 2):
        if i + 1 < len(lines) and lines[i + 1].strip() and set(lines[i + 1].strip()) == {"-"}:
            break  # the title of the next section
        if line.strip() and len(line) - len(line.lstrip()) == indent:
            names += [name.strip(" *") for name in re.split(r"\s:(?:\s|$)", line)[0].split(",")]
    return names


def arguments(function: Function) -> dict[str, str]:
    """Return a function's arguments with their annotations, without self and cls."""
    a = function.args
    named = [*a.posonlyargs, *a.args, a.vararg, *a.kwonlyargs, a.kwarg]
    return {
        arg.arg: ast.unparse(arg.annotation) if arg.annotation else ""
        for arg in named
        if arg is not None and arg.arg not in {"self", "cls"}
    }


def fields(cls: ast.ClassDef) -> tuple[dict[str, str], set[str]]:
    """Return a class's fields with their annotations, and which have a docstring of their own."""
    annotations: dict[str, str] = {}
    described: set[str] = set()
    for node, following in zip(cls.body, [*cls.body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        annotations[node.target.id] = ast.unparse(node.annotation)
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            described.add(node.target.id)
    return annotations, described


def public_definitions(body: list[ast.stmt]) -> Iterator[Definition]:
    """Yield public functions and classes, and the public methods of public classes."""
    for node in body:
        if not isinstance(node, Definition) or node.name.startswith("_"):
            continue
        yield node
        if isinstance(node, ast.ClassDef):
            yield from public_definitions(node.body)


def complaint(node: Definition) -> str | None:
    """Return what is wrong with the Parameters section of *node*; None without such a section.

    It names nothing that is not there, keeps a function's order, and leaves out no array and no
    number, whose shape, unit and frame nobody can guess. What a type says fully may be left out.
    """
    listed = documented_parameters(ast.get_docstring(node) or "")
    if listed is None or any("click" in ast.unparse(d) for d in node.decorator_list):
        return None
    described: set[str] = set()
    if isinstance(node, ast.ClassDef):
        init = next((n for n in node.body if getattr(n, "name", "") == "__init__"), None)
        if isinstance(init, Function):
            real = arguments(init)
        else:
            real, described = fields(node)
    else:
        real = arguments(node)
    if unreal := [name for name in listed if name not in real]:
        return f"documents {unreal}, which it does not have"
    if not isinstance(node, ast.ClassDef) and listed != [name for name in real if name in listed]:
        return f"documents {listed} in another order than it takes them"
    silent = [
        name
        for name, annotation in real.items()
        if NEEDS_WORDS.search(annotation) and name not in {*listed, *described}
    ]
    return f"says nothing about {silent}" if silent else None


def test_documented_parameters_are_the_real_ones(library_files: list[Path]) -> None:
    wrong = [
        f"{file}:{node.lineno} {node.name}: {text}"
        for file in library_files
        for node in public_definitions(ast.parse(file.read_text("utf-8")).body)
        if (text := complaint(node))
    ]
    assert not wrong, "\n".join(wrong)


def test_public_names_have_a_docstring(library_files: list[Path]) -> None:
    without = [
        f"{file}:{node.lineno} {node.name}"
        for file in library_files
        for node in public_definitions(ast.parse(file.read_text("utf-8")).body)
        if not ast.get_docstring(node) and "overload" not in ast.unparse(node)
    ]
    assert not without, "\n".join(without)


def definition(head: str, *lines: str, tail: str = "") -> Definition:
    section = "".join(f"    {line}\n" for line in ("Parameters", "----------", *lines))
    node = ast.parse(f"{head}\n    '''Do.\n\n{section}    '''\n{tail}").body[0]
    assert isinstance(node, Definition)
    return node


@pytest.mark.parametrize(
    "node",
    [
        definition("def f(a: Array, b: float):", "a, b : array", "    Sizes."),
        definition("def f(robot: Robot, a: float):", "a : float"),
        definition("def f(*a: float, **k: float):", "*a : float", "**k", "    Rest."),
        definition("class C:", "a : float", tail="    a: float\n    b: float\n    'B.'"),
        definition("class C:", "b : float", "a : float", tail="    a: float\n    b: float"),
    ],
    ids=ast.unparse,
)
def test_this_rule_accepts_a_right_docstring(node: Definition) -> None:
    assert complaint(node) is None


@pytest.mark.parametrize(
    ("node", "words"),
    [
        (definition("def f(a: int):", "a", "c : int"), "does not have"),
        (definition("def f(a: int, b: int):", "b : int", "a : int"), "order"),
        (definition("def f(a: int, h: Array):", "a : int"), "nothing about"),
        (definition("class C:", "a : int", tail="    a: int\n    b: float"), "nothing about"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_this_rule_sees_a_wrong_docstring(node: Definition, words: str) -> None:
    assert words in (complaint(node) or "")
