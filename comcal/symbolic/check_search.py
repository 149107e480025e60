# SPDX-License-Identifier: Apache-2.0
"""The first term of a formula, in the order of the file, whose change makes the rest agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.check_evaluation import Evaluation
from comcal.symbolic.check_fault import FaultKind, Reading, TermFault
from comcal.symbolic.check_points import Kind, Points
from comcal.symbolic.check_vocabulary import (
    Vocabulary,
    distinct_symbols,
    scaled,
    simple_factor,
    single_factors,
    vocabulary,
)
from comcal.symbolic.formula_edit import (
    argument_paths,
    multiplied,
    own_parts,
    sum_paths,
    terms_in_order,
    with_term_added,
    with_term_at,
    without_term,
)
from comcal.symbolic.formula_tree import (
    COSINE_OF,
    Node,
    Path,
    as_sum,
    evaluate,
    node_at,
    number,
    symbol,
    symbols_of,
    term_text,
    text_of,
    with_node,
)

GLANCE = 8
"""Points at which candidates are tried; what passes is tried at all points."""
EXPONENTS = (1, 2, 3)


@dataclass(frozen=True)
class _Change:
    """A formula with one term changed: the sum and the term in it, and what it has become."""

    kind: FaultKind
    sum_path: Path
    term: int
    root: Node


def find_fault(root: Node, points: Points, target: Array, reading: Reading) -> TermFault | None:
    """Return the first single change that makes a formula agree at every point.

    Parameters
    ----------
    root : Node
        A formula that does not agree.
    points : Points
    target : array, shape (count,)
        What it should be; zero for an equation.
    reading : Reading

    Returns
    -------
    TermFault or None
        None if no single change of a term explains the difference.
    """
    whole = _whole(root, Evaluation(root, points.values, target), reading.names)
    if whole is not None:
        return whole
    glance = _Search(root, points.only(slice(GLANCE)), target[:GLANCE], reading)
    for change in glance.changes():
        right = Evaluation(change.root, points.values, target).agrees()
        if right and reading.still_says(change.root):
            return _described(root, change, reading.names)
    return None


class _Search:
    def __init__(self, root: Node, points: Points, target: Array, reading: Reading) -> None:
        self.root = root
        self.points = points
        self.reading = reading
        self.at = Evaluation(root, points.values, target)
        self.used = symbols_of(root)
        self.singles = single_factors(points, self.used, reading.exclude)
        self.distinct = distinct_symbols(points, self.used, reading.exclude)

    def changes(self) -> Iterator[_Change]:
        """Yield the changes that agree at these points, those of present terms first."""
        sums = list(sum_paths(self.root, ()))
        for sum_path, i in terms_in_order(self.root, sums):
            yield from self._of_term(sum_path, i)
        words = vocabulary(self.points, self.used, self.reading.exclude)
        yield from self._missing(sums, words)
        yield from self._missing_angles()

    def _of_term(self, sum_path: Path, i: int) -> Iterator[_Change]:
        path = (*sum_path, i)
        value = self.at.at(path)
        parent = node_at(self.root, sum_path)
        if self._passes(path, -value):
            flipped = with_term_at(parent, i, parent.children[i], negative=True)
            yield self._change(FaultKind.SIGN, sum_path, i, flipped)
        if self._passes(path, 0.0 * value):
            yield self._change(FaultKind.EXTRA, sum_path, i, without_term(parent, i))
        for kind, inner, new in self._variants(path):
            if self._passes(inner, evaluate(new, self.points.values)):
                yield _Change(kind, sum_path, i, with_node(self.root, inner, new))
        yield from self._rescaled(sum_path, i)

    def _variants(self, path: Path) -> Iterator[tuple[FaultKind, Path, Node]]:
        """Yield what could stand in the place of a part of a term, but not of its own brackets."""
        own = [(p, node_at(self.root, p)) for p in own_parts(self.root, path)]
        for p, node in own:
            if node.op == "call" and node.name in COSINE_OF:
                yield FaultKind.SINE_COSINE, p, replace(node, name=COSINE_OF[node.name])
        for p, node in own:
            if node.op == "symbol":
                for name in self._alternatives(node.name):
                    yield FaultKind.INDEX, p, symbol(name)
        for p, node in own:
            if node.op == "power":
                for exponent in EXPONENTS:
                    new = replace(node, children=(node.children[0], number(exponent)))
                    yield FaultKind.EXPONENT, p, node.children[0] if exponent == 1 else new
            elif node.op == "symbol" or (node.op == "call" and node.name in COSINE_OF):
                yield FaultKind.EXPONENT, p, Node("power", children=(node, number(2)))

    def _alternatives(self, name: str) -> list[str]:
        """Return the symbols that may be meant, those of the same letter and of the file first."""
        kind = self.points.kinds[name]
        alike = [n for n in self.distinct if self.points.kinds[n] is kind and n != name]
        stem = name.split("_")[0].lower()
        return sorted(alike, key=lambda n: (n.split("_")[0].lower() != stem, n not in self.used))

    def _rescaled(self, sum_path: Path, i: int) -> Iterator[_Change]:
        path = (*sum_path, i)
        wanted = self.at.wanted(path)
        if wanted is None:
            return
        with np.errstate(all="ignore"):
            ratio = wanted / self.at.at(path)
        if not np.all(np.isfinite(ratio)):
            return
        term = node_at(self.root, path)
        parent = node_at(self.root, sum_path)
        factor = simple_factor(ratio)
        if factor is not None:
            new = with_term_at(parent, i, scaled(factor, term), negative=factor < 0)
            yield self._change(FaultKind.COEFFICIENT, sum_path, i, new)
        for node, value in self.singles:
            for new_term in multiplied(term, node, ratio, value):
                yield self._change(FaultKind.FACTOR, sum_path, i, with_term_at(parent, i, new_term))

    def _missing(self, sums: list[Path], words: Vocabulary) -> Iterator[_Change]:
        """Yield sums with one more term; the shortest term first, then the order of the file."""
        found: list[tuple[int, int, Path, Fraction, Node | None]] = []
        for order, path in enumerate(sums):
            wanted = self.at.wanted(path)
            if wanted is None:
                continue
            for factor, term in words.candidates(wanted - self.at.at(path)):
                length = 0 if term is None else max(1, len(term.children))
                if term is not None and term.op == "call":
                    length = 1
                found.append((length, order, path, factor, term))
        for _, _, path, factor, term in sorted(found, key=lambda f: f[:2]):
            new = with_term_added(
                node_at(self.root, path), scaled(factor, term), negative=factor < 0
            )
            yield self._change(FaultKind.DROPPED, path, len(new.children) - 1, new)

    def _missing_angles(self) -> Iterator[_Change]:
        """Yield functions with one more angle in their argument."""
        angles = [n for n in self.distinct if self.points.kinds[n] is Kind.ANGLE]
        for path in argument_paths(self.root, ()):
            for name in angles:
                for negative in (False, True):
                    new = with_term_added(as_sum(node_at(self.root, path)), symbol(name), negative)
                    if self._passes(path, evaluate(new, self.points.values)):
                        yield self._change(FaultKind.DROPPED, path, len(new.children) - 1, new)

    def _passes(self, path: Path, value: Array) -> bool:
        return self.at.agrees(self.at.replaced(path, value))

    def _change(self, kind: FaultKind, sum_path: Path, i: int, new_sum: Node) -> _Change:
        return _Change(kind, sum_path, i, with_node(self.root, sum_path, new_sum))


def _whole(root: Node, at: Evaluation, names: Mapping[Node, str]) -> TermFault | None:
    """Return the fault of a formula that is wrong by one factor as a whole."""
    if root.op != "sum" or len(root.children) < 2:
        return None
    with np.errstate(all="ignore"):
        factor = simple_factor(at.target / at.value)
    if factor is None:
        return None
    kind = FaultKind.SIGN if factor == -1 else FaultKind.COEFFICIENT
    new = Node("sum", children=(scaled(factor, root),), inverse=(factor < 0,))
    text = text_of(new, names)
    return TermFault(kind, text_of(root, names), "", text, text)


def _described(root: Node, change: _Change, names: Mapping[Node, str]) -> TermFault:
    before, after = node_at(root, change.sum_path), node_at(change.root, change.sum_path)
    added, gone = change.kind is FaultKind.DROPPED, change.kind is FaultKind.EXTRA
    plus = change.kind in {FaultKind.SIGN, FaultKind.DROPPED}
    outer = _outer_term(root, change.sum_path)
    within = "" if outer is None else term_text(outer[0], outer[1], names)
    return TermFault(
        kind=change.kind,
        term="" if added else term_text(before, change.term, names, plus=plus),
        within=within,
        correct="" if gone else term_text(after, change.term, names, plus=plus),
        corrected=text_of(change.root, names),
    )


def _outer_term(root: Node, path: Path) -> tuple[Node, int] | None:
    """Return the outermost sum on the way to *path* and which of its terms it passes through."""
    node = root
    for i in path:
        if node.op == "sum":
            return node, i
        node = node.children[i]
    return None
