# SPDX-License-Identifier: Apache-2.0
"""Finding and changing the terms of a formula without disturbing the rest of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.formula_tree import Node, Path, evaluate, node_at, number, product


def sum_paths(node: Node, path: Path) -> Iterator[Path]:
    """Yield the sums in the order in which they begin."""
    if node.op == "sum":
        yield path
    for i, child in enumerate(node.children):
        yield from sum_paths(child, (*path, i))


def terms_in_order(root: Node, sums: Sequence[Path]) -> list[tuple[Path, int]]:
    """Return all terms in the order of the file; one with brackets before the terms in them."""
    terms = [(path, i) for path in sums for i in range(len(node_at(root, path).children))]
    return sorted(terms, key=lambda term: (*term[0], term[1]))


def own_parts(root: Node, path: Path) -> Iterator[Path]:
    """Yield the parts of a term that belong to no sum inside it, in order."""
    yield path
    node = node_at(root, path)
    for i, child in enumerate(node.children if node.op != "sum" else ()):
        if child.op != "sum":
            yield from own_parts(root, (*path, i))


def argument_paths(node: Node, path: Path) -> Iterator[Path]:
    """Yield the arguments of functions."""
    for i, child in enumerate(node.children):
        if node.op == "call":
            yield (*path, i)
        yield from argument_paths(child, (*path, i))


def with_term_at(parent: Node, i: int, term: Node, *, negative: bool = False) -> Node:
    """Return a sum with term *i* replaced, its sign changed if *negative*."""
    children, signs = list(parent.children), list(parent.inverse)
    children[i] = term
    signs[i] = signs[i] != negative
    return replace(parent, children=tuple(children), inverse=tuple(signs))


def without_term(parent: Node, i: int) -> Node:
    """Return a sum without term *i*, zero if it was the only one."""
    if len(parent.children) == 1:
        return with_term_at(parent, i, number(0))
    return replace(
        parent,
        children=parent.children[:i] + parent.children[i + 1 :],
        inverse=parent.inverse[:i] + parent.inverse[i + 1 :],
    )


def with_term_added(parent: Node, term: Node, negative: bool) -> Node:
    """Return a sum with one more term; it takes the place of a lonely zero."""
    if len(parent.children) == 1 and parent.children[0].op == "number":
        value = evaluate(parent.children[0], {"": np.zeros(1)})
        if not np.any(value):
            return replace(parent, children=(term,), inverse=(negative,))
    children, inverse = (*parent.children, term), (*parent.inverse, negative)
    return replace(parent, children=children, inverse=inverse)


def multiplied(term: Node, factor: Node, ratio: Array, value: Array) -> Iterator[Node]:
    """Yield the term times or over *factor*, if that is what the ratio asks for."""
    near = 1e-9 * np.abs(ratio)
    if np.all(np.abs(ratio - value) <= near):
        yield product(*_plain_factors(term), factor)
    with np.errstate(all="ignore"):
        inverse = 1.0 / value
    if np.all(np.abs(ratio - inverse) <= near):
        factors = _plain_factors(term)
        if factor in factors:
            factors.remove(factor)
            yield product(*factors) if factors else number(1)
        else:
            yield product(term, divisor=factor)


def _plain_factors(term: Node) -> list[Node]:
    if term.op == "product" and not any(term.inverse):
        return list(term.children)
    return [term]
