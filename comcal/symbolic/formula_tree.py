# SPDX-License-Identifier: Apache-2.0
"""A formula exactly as it was written: nothing is reordered, cancelled or expanded.

A computer algebra system would sort the terms as it reads them, and the place of a mistake would
be lost. Formulas are evaluated over numpy arrays, one element for each random point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from comcal.robot.tree import Array

Op = Literal["number", "symbol", "call", "power", "product", "sum", "equation"]
Path = tuple[int, ...]


def _one_over(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda x: 1.0 / function(x)


FUNCTIONS: Final[Mapping[str, tuple[int, Callable[..., Array]]]] = {
    "sin": (1, np.sin),
    "cos": (1, np.cos),
    "tan": (1, np.tan),
    "cot": (1, _one_over(np.tan)),
    "sec": (1, _one_over(np.cos)),
    "csc": (1, _one_over(np.sin)),
    "asin": (1, np.arcsin),
    "acos": (1, np.arccos),
    "atan": (1, np.arctan),
    "atan2": (2, np.arctan2),
    "sqrt": (1, np.sqrt),
    "exp": (1, np.exp),
    "log": (1, np.log),
}
"""Name of every function a formula may call, with its number of arguments."""
CONSTANTS: Final[Mapping[str, float]] = {"pi": float(np.pi)}
COSINE_OF: Final[Mapping[str, str]] = {"sin": "cos", "cos": "sin"}

_SUM, _PRODUCT, _POWER, _ATOM = range(4)
"""How tightly a node binds."""


@dataclass(frozen=True)
class Node:
    """A part of a formula.

    Parameters
    ----------
    op : str
    name : str
        Of a symbol or function; the digits of a number.
    children : tuple of Node
        Terms, factors, arguments; base and exponent; left and right side.
    inverse : tuple of bool
        Of a sum: which terms are subtracted. Of a product: which factors divide.
    """

    op: Op
    name: str = ""
    children: tuple[Node, ...] = ()
    inverse: tuple[bool, ...] = ()


def number(value: float) -> Node:
    """Return a number that is not negative as a node [any unit]."""
    return Node("number", f"{value:g}")


def symbol(name: str) -> Node:
    """Return a symbol as a node."""
    return Node("symbol", name)


def product(*factors: Node, divisor: Node | None = None) -> Node:
    """Return the product of *factors*, over *divisor* if there is one."""
    children = factors if divisor is None else (*factors, divisor)
    if len(children) == 1:
        return children[0]
    inverse = (False,) * len(factors) + (True,) * (divisor is not None)
    return Node("product", children=children, inverse=inverse)


def as_sum(node: Node) -> Node:
    """Return *node* as a sum, of one term if it is none."""
    return node if node.op == "sum" else Node("sum", children=(node,), inverse=(False,))


def symbols_of(node: Node) -> list[str]:
    """Return the names of all symbols in the order in which they stand, each once."""
    found: dict[str, None] = {}
    stack = [node]
    while stack:
        here = stack.pop()
        if here.op == "symbol":
            found[here.name] = None
        stack.extend(reversed(here.children))
    return list(found)


def size_of(node: Node) -> int:
    """Return the number of nodes."""
    return 1 + sum(size_of(child) for child in node.children)


def node_at(root: Node, path: Path) -> Node:
    """Return the node at *path*: which child of which child."""
    for i in path:
        root = root.children[i]
    return root


def with_node(root: Node, path: Path, new: Node) -> Node:
    """Return *root* with the node at *path* replaced."""
    if not path:
        return new
    children = list(root.children)
    children[path[0]] = with_node(children[path[0]], path[1:], new)
    return replace(root, children=tuple(children))


def combine(node: Node, values: Sequence[Array]) -> Array:
    """Return the value of *node* from those of its children, shape (count,).

    Parameters
    ----------
    node : Node
    values : sequence of array, shape (count,)
    """
    if node.op == "sum":
        total = -values[0] if node.inverse[0] else values[0]
        for value, subtracted in zip(values[1:], node.inverse[1:], strict=True):
            total = total - value if subtracted else total + value
        return total
    if node.op == "product":
        total = 1.0 / values[0] if node.inverse[0] else values[0]
        for value, divides in zip(values[1:], node.inverse[1:], strict=True):
            total = total / value if divides else total * value
        return total
    if node.op == "power":
        return np.power(values[0], values[1])
    if node.op == "equation":
        return values[0] - values[1]
    return FUNCTIONS[node.name][1](*values)


def leaf(node: Node, env: Mapping[str, Array]) -> Array:
    """Return the value of a number or symbol, shape (count,).

    Parameters
    ----------
    node : Node
    env : mapping of str to array, shape (count,)
        At least one symbol.
    """
    if node.op == "symbol":
        return env[node.name]
    value = CONSTANTS[node.name] if node.name in CONSTANTS else float(node.name)
    return np.full_like(next(iter(env.values())), value)


def evaluate(node: Node, env: Mapping[str, Array]) -> Array:
    """Return the value of a formula at every point, shape (count,); not finite where it has none.

    Parameters
    ----------
    node : Node
    env : mapping of str to array, shape (count,)
        Value of every symbol, in SI.
    """
    with np.errstate(all="ignore"):
        return _evaluate(node, env)


def _evaluate(node: Node, env: Mapping[str, Array]) -> Array:
    if not node.children:
        return leaf(node, env)
    return combine(node, [_evaluate(child, env) for child in node.children])


def text_of(node: Node, names: Mapping[Node, str]) -> str:
    """Return a formula as text.

    Parameters
    ----------
    node : Node
    names : mapping of Node to str
        The reader's own names for symbols or for expressions such as ``sin(theta_b)``.
    """
    return _text(node, names)[0]


def term_text(parent: Node, i: int, names: Mapping[Node, str], *, plus: bool = False) -> str:
    """Return term *i* of a sum with its sign; a plus only if asked for."""
    sign = "-" if parent.inverse[i] else "+" if plus else ""
    return sign + _bracketed(parent.children[i], names, _PRODUCT)


def _text(node: Node, names: Mapping[Node, str]) -> tuple[str, int]:
    """Return the text of *node* and how tightly it binds."""
    if node in names:
        return names[node], _ATOM
    if node.op in {"number", "symbol"}:
        return node.name, _ATOM
    if node.op == "call":
        return f"{node.name}({', '.join(text_of(c, names) for c in node.children)})", _ATOM
    if node.op == "power":
        base, exponent = (_bracketed(c, names, _ATOM) for c in node.children)
        return f"{base}**{exponent}", _POWER
    if node.op == "equation":
        return " = ".join(text_of(c, names) for c in node.children), _SUM
    if node.op == "sum":
        if len(node.children) == 1 and not node.inverse[0]:
            return _text(node.children[0], names)
        text = term_text(node, 0, names)
        for i in range(1, len(node.children)):
            signed = term_text(node, i, names, plus=True)
            text += f" {signed[0]} {signed[1:]}"
        return text, _SUM
    text = "1" if node.inverse[0] else ""
    for child, divides in zip(node.children, node.inverse, strict=True):
        # Binding as tightly as a power keeps a divisor's own product in brackets.
        text += ("/" if divides else "*" if text else "") + _bracketed(child, names, _POWER)
    return text, _PRODUCT


def _bracketed(node: Node, names: Mapping[Node, str], least: int) -> str:
    text, binding = _text(node, names)
    return text if binding >= least else f"({text})"
