# SPDX-License-Identifier: Apache-2.0
"""The words that formulas of this field are made of, to recognise a term that is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.check_points import Kind, Points
from comcal.symbolic.formula_tree import Node, number, product, symbol

LARGEST_DENOMINATOR = 24
"""Of a coefficient that counts as simple."""
LARGEST_COEFFICIENT = 24
MOST_WORDS = 200_000
"""Candidate terms; above this, products of fewer angles' sines and cosines are tried."""
_SAME = 1e-9


@dataclass(frozen=True)
class Vocabulary:
    """All candidate terms with their values.

    Parameters
    ----------
    words : list of tuple of Node
        Factors of each term.
    values : array, shape (n_words, count)
    """

    words: list[tuple[Node, ...]]
    values: Array

    def candidates(self, wanted: Array) -> Iterator[tuple[Fraction, Node | None]]:
        """Yield what *wanted* may be: a simple number times a term, those of few factors first.

        Parameters
        ----------
        wanted : array, shape (count,)

        Yields
        ------
        Fraction, Node or None
            None if it is the number alone.
        """
        if not np.all(np.isfinite(wanted)) or not np.all(np.abs(wanted) > 0.0):
            return
        with np.errstate(all="ignore"):
            ratio = wanted[:2] / self.values[:, :2]
            alike = np.abs(ratio[:, 1] - ratio[:, 0]) <= _SAME * np.abs(ratio[:, 0])
        found: list[tuple[int, bool, int, Fraction]] = []
        for k in np.flatnonzero(alike):
            factor = simple_factor(wanted / self.values[k])
            if factor is not None:
                found.append((len(self.words[k]), abs(factor) != 1, int(k), factor))
        for _, _, k, factor in sorted(found):
            yield factor, product(*self.words[k]) if self.words[k] else None


def vocabulary(
    points: Points, used: Sequence[str], exclude: Sequence[str], most_angles: int = 3
) -> Vocabulary:
    """Return the products of at most one symbol of each kind and sines and cosines of angles.

    Parameters
    ----------
    points : Points
    used : sequence of str
        Symbols of the formula: preferred where two names have one value.
    exclude : sequence of str
        Symbols that may not be used.
    most_angles : int
        Sines and cosines in one product.
    """
    names = distinct_symbols(points, used, exclude)
    words: list[tuple[Node, ...]] = [()]
    count = len(next(iter(points.values.values())))
    values = np.ones((1, count))
    for kind in Kind:
        members = [name for name in names if points.kinds[name] is kind]
        if not members or kind is Kind.ANGLE:
            continue
        own = np.array([points.values[name] for name in members])
        # First moments and determinants are products themselves.
        most = 1 if kind in {Kind.FIRST_MOMENT, Kind.DETERMINANT} else len(words)
        more = [(*word, symbol(name)) for name in members for word in words[:most]]
        words = words + more
        values = np.concatenate([values, (own[:, None, :] * values[:most]).reshape(-1, count)])
    turns, turned = _turns(points.values, [n for n in names if points.kinds[n] is Kind.ANGLE])
    for degree in range(most_angles, 0, -1):
        sets = [s for d in range(1, degree + 1) for s in _sets(len(turns), d)]
        if (len(sets) + 1) * len(words) <= MOST_WORDS:
            break
    else:
        sets = []
    products = np.array([np.prod(turned[list(s)], axis=0) for s in sets]).reshape(-1, count)
    every = words + [(*word, *(turns[i] for i in s)) for s in sets for word in words]
    all_values = np.concatenate([values, (products[:, None, :] * values).reshape(-1, count)])
    return Vocabulary(every, all_values)


def single_factors(
    points: Points, used: Sequence[str], exclude: Sequence[str]
) -> list[tuple[Node, Array]]:
    """Return every symbol, sine and cosine by itself, with its value.

    Parameters
    ----------
    points : Points
    used, exclude : sequence of str
        As for :func:`vocabulary`.
    """
    names = distinct_symbols(points, used, exclude)
    turns, values = _turns(points.values, [n for n in names if points.kinds[n] is Kind.ANGLE])
    return [
        *((symbol(n), points.values[n]) for n in names if points.kinds[n] is not Kind.ANGLE),
        *zip(turns, values, strict=True),
    ]


def distinct_symbols(points: Points, used: Sequence[str], exclude: Sequence[str]) -> list[str]:
    """Return names no two of which have one value and none of which is zero, *used* ones first."""
    kept: list[str] = []
    ordered = [*(n for n in used if n in points.values), *points.values]
    for name in dict.fromkeys(ordered):
        value = points.values[name]
        same = any(
            points.kinds[name] is points.kinds[other]
            and np.array_equal(value, points.values[other])
            for other in kept
        )
        if name not in exclude and not same and np.any(value):
            kept.append(name)
    return kept


def simple_factor(ratio: Array, tolerance: float = 10 * _SAME) -> Fraction | None:
    """Return the simple number that *ratio* is at every point, None if it is none or zero.

    Parameters
    ----------
    ratio : array, shape (count,)
    tolerance : float
        Relative [1].
    """
    first = float(ratio[0])
    if not np.all(np.isfinite(ratio)) or abs(first) > LARGEST_COEFFICIENT + 1:
        return None
    simple = Fraction(first).limit_denominator(LARGEST_DENOMINATOR)
    same = np.all(np.abs(ratio - float(simple)) <= tolerance * abs(first))
    return simple if same and simple != 0 else None


def scaled(factor: Fraction, term: Node | None) -> Node:
    """Return a positive number times a term."""
    top, bottom = abs(factor.numerator), factor.denominator
    factors = [] if top == 1 and term is not None else [number(top)]
    if term is not None:
        factors += list(term.children) if _is_plain_product(term) else [term]
    return product(*factors, divisor=number(bottom) if bottom != 1 else None)


def _is_plain_product(node: Node) -> bool:
    return node.op == "product" and not any(node.inverse)


def _turns(values: Mapping[str, Array], angles: Sequence[str]) -> tuple[list[Node], Array]:
    nodes = [Node("call", f, (symbol(a),)) for a in angles for f in ("sin", "cos")]
    found = [f(values[a]) for a in angles for f in (np.sin, np.cos)]
    return nodes, np.array(found)


def _sets(n: int, size: int) -> Iterator[tuple[int, ...]]:
    return combinations_with_replacement(range(n), size)
