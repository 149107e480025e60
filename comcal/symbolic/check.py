# SPDX-License-Identifier: Apache-2.0
"""Hand-written formulas against the moment balance, at random points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from comcal.errors import ConfigError
from comcal.robot.tree import Array
from comcal.symbolic.check_claim import Claim, EntryReport, FormulaReport, Line
from comcal.symbolic.check_evaluation import AGREES, Evaluation
from comcal.symbolic.check_fault import Reading
from comcal.symbolic.check_models import determinant
from comcal.symbolic.check_points import Draw, Points
from comcal.symbolic.check_quantities import Values, numerator
from comcal.symbolic.check_remainder import find_remainder
from comcal.symbolic.check_search import find_fault
from comcal.symbolic.formula_parse import own_names, parse_formula, parse_symbol
from comcal.symbolic.formula_tree import Node, evaluate, symbols_of, text_of

POINTS = 300
"""Random points at which a formula is compared."""
FEWEST = 50
"""Points at which it must have a value; elsewhere a root or a logarithm may be undefined."""
SEED = 2017
"""One formula always gives one report."""

SEARCHES = (find_fault, find_remainder)

Truth = Callable[[Values], Array]


def check_claim(claim: Claim) -> FormulaReport:
    """Compare a formula or a matrix with the truth, and find the term that is wrong.

    Parameters
    ----------
    claim : Claim

    Raises
    ------
    ConfigError
        If a formula cannot be read, has no value, or says nothing about the quantity.

    Notes
    -----
    Agreement at the points is what counts: a formula may be rewritten in any way.
    """
    checker = _Checker(claim)
    if claim.formula is not None:
        return FormulaReport(claim.quantity, POINTS, (checker.scalar(claim.formula),))
    return checker.matrix()


class _Checker:
    def __init__(self, claim: Claim) -> None:
        self.claim = claim
        self.quantity = claim.quantity
        self.linked = self._points(linked=True)
        # Where m_w is free there are fewer ways to explain a fault away.
        self.free = self._points(linked=False)
        ours = own_names(list(self.linked.values))
        self.known = dict(ours)
        self.names: dict[Node, str] = {}
        for theirs, line in claim.symbols.items():
            node = parse_symbol(line.text, ours, line.where)
            self.known[theirs] = node
            self.names.setdefault(node, theirs)
        # What the file uses for something else may not appear in a correction as ours.
        self.shadowed = tuple(
            name
            for name, node in ours.items()
            if self.known[name] != node and node not in self.names
        )

    def scalar(self, line: Line) -> EntryReport:
        quantity = self.quantity
        if quantity.shape is not None and quantity.column is None:
            raise ConfigError(
                f"{quantity.name} is a matrix, not a single formula",
                where=line.where,
                next_step=f"give its {quantity.shape[0]} rows under `matrix`",
            )
        root = self._parse(line)
        if root.op == "equation":
            entry = self._entry(root, line, _zero)
            if entry.agrees:
                self._refuse_tautology(root, line)
            return entry
        self._refuse_naming(root, line, quantity.about)
        return self._entry(root, line, quantity.value, exclude=quantity.about)

    def matrix(self) -> FormulaReport:
        quantity, column = self.quantity, self.quantity.column
        cells = self._cells()
        exclude = quantity.about if column is None else (*quantity.about, "det_A")
        truth: Truth = quantity.value if column is None else lambda v: numerator(v, column)
        entries: list[EntryReport] = []
        linked_truth, free_truth = truth(self.linked.values), truth(self.free.values)
        truths = {id(self.linked): linked_truth, id(self.free): free_truth}
        for r, row in enumerate(cells):
            for c, (line, root) in enumerate(row):
                self._refuse_naming(root, line, exclude)
                of_cell = {key: value[r, c] for key, value in truths.items()}
                entries.append(
                    self._compare(root, line, of_cell, exclude=exclude, place=(r + 1, c + 1))
                )
        if column is None:
            return FormulaReport(quantity, POINTS, tuple(entries))
        over = Line("det_A", "") if self.claim.over is None else self.claim.over
        divisor = self._parse(over)
        if self.claim.over is not None:
            self._refuse_naming(divisor, over, quantity.about)
            entries.append(self._entry(divisor, over, lambda v: v["det_A"], exclude=exclude))
        report = FormulaReport(quantity, POINTS, tuple(entries))
        if report.agrees or not self._same_quotient(
            [[n for _, n in row] for row in cells], divisor
        ):
            return report
        return FormulaReport(quantity, POINTS, tuple(entries), rewritten=True)

    def _cells(self) -> list[list[tuple[Line, Node]]]:
        """Return the entries of the matrix, of the right size."""
        quantity, matrix = self.quantity, self.claim.matrix
        where = next((line.where for row in matrix for line in row), "")
        if quantity.shape is None:
            raise ConfigError(
                f"{quantity.name} is not a matrix",
                where=where,
                next_step="give one expression or equation under `formula`",
            )
        rows, columns = quantity.shape
        lengths = [len(row) for row in matrix]
        if lengths != [columns] * rows:
            raise ConfigError(
                f"the matrix for {quantity.name} has the wrong size",
                where=where,
                measured=f"{len(lengths)} rows of {' '.join(map(str, sorted({*lengths})))}",
                limit=f"{rows} rows of {columns}",
                next_step="write every entry, zeros too",
            )
        cells = [[(line, self._parse(line)) for line in row] for row in matrix]
        for line, root in (cell for row in cells for cell in row):
            if root.op == "equation":
                raise ConfigError("an entry of a matrix cannot be an equation", where=line.where)
        return cells

    def _entry(
        self, root: Node, line: Line, truth: Truth, exclude: Sequence[str] = ()
    ) -> EntryReport:
        targets = {id(p): truth(p.values) for p in (self.linked, self.free)}
        return self._compare(root, line, targets, exclude=exclude)

    def _compare(
        self,
        root: Node,
        line: Line,
        targets: Mapping[int, Array],
        *,
        exclude: Sequence[str] = (),
        place: tuple[int, int] | None = None,
    ) -> EntryReport:
        """Return the report of one formula; *targets* by the identity of the points."""
        points, target = self._with_value(root, line, self.linked, targets[id(self.linked)])
        error = Evaluation(root, points.values, target).error()
        fault = None
        if not np.all(error <= AGREES):
            reading = Reading(self.names, (*exclude, *self.shadowed), self._still_says)
            sets = [
                self._with_value(root, line, where, targets[id(where)])
                for where in (self.free, self.linked)
            ]
            tries = (search(root, *at, reading) for search in SEARCHES for at in sets)
            fault = next((found for found in tries if found is not None), None)
        return EntryReport(
            line.where,
            place,
            text_of(root, self.names),
            worst=float(np.max(error)),
            median=float(np.median(error)),
            right_at=float(np.mean(error <= AGREES)),
            fault=fault,
        )

    def _with_value(
        self, root: Node, line: Line, points: Points, target: Array
    ) -> tuple[Points, Array]:
        """Return the points at which a formula has a value."""
        good = np.isfinite(evaluate(root, points.values))
        if good.all():
            return points, target
        if np.count_nonzero(good) < FEWEST:
            raise ConfigError(
                "the formula has no finite value",
                where=line.where,
                measured=f"at {np.count_nonzero(~good)} of {good.size} random points",
                next_step="look for a division by zero or the root of a negative number",
            )
        return points.only(good), target[good]

    def _same_quotient(self, cells: list[list[Node]], divisor: Node) -> bool:
        """Return whether the quotient of the determinants is right, whatever the entries are."""
        v = self.linked.values
        N = np.array([[evaluate(node, v) for node in row] for row in cells])
        with np.errstate(all="ignore"):
            value = determinant(N) / evaluate(divisor, v)
        target = self.quantity.value(v)
        return bool(np.all(np.abs(value - target) <= AGREES * np.abs(target)))

    def _refuse_tautology(self, root: Node, line: Line) -> None:
        """Refuse an equation that would hold for any value of the quantity."""
        if not self._still_says(root):
            names = " or ".join(self._shown(name) for name in self.quantity.about)
            raise ConfigError(
                f"the equation says nothing about {self.quantity.name}: it does not depend on it",
                where=line.where,
                next_step=f"write one that contains {names}",
            )

    def _still_says(self, root: Node) -> bool:
        """Return whether an equation depends on the quantity; an expression is the quantity."""
        if root.op != "equation":
            return True
        values = dict(self.linked.values)
        rng = np.random.default_rng(SEED)
        for name in self.quantity.about:
            values[name] = values[name] * rng.uniform(1.2, 2.0, POINTS)
        before = Evaluation(root, self.linked.values, _zero(values))
        after = Evaluation(root, values, _zero(values))
        with np.errstate(all="ignore"):
            return bool(np.any(np.abs(after.value - before.value) > AGREES * after.scale))

    def _refuse_naming(self, root: Node, line: Line, about: Sequence[str]) -> None:
        if root.op == "equation":
            raise ConfigError("one side of an equation is enough here", where=line.where)
        named = [name for name in symbols_of(root) if name in about]
        if named:
            raise ConfigError(
                f"the formula for {self.quantity.name} contains {self._shown(named[0])}, which is "
                "what it should say",
                where=line.where,
                next_step="leave it out, or write an equation with =",
            )

    def _parse(self, line: Line) -> Node:
        return parse_formula(line.text, self.known, line.where)

    def _shown(self, name: str) -> str:
        return text_of(own_names([name])[name], self.names)

    def _points(self, *, linked: bool) -> Points:
        draw = Draw(np.random.default_rng(SEED), POINTS, linked, self._posture)
        return self.quantity.points(draw, self.claim.links)

    def _posture(self, angles: Mapping[str, Array]) -> Mapping[str, Array]:
        """Return the angles of the configuration that the file asks for."""
        known = own_names(list(angles))
        posture = dict(angles)
        for name, line in self.claim.configuration.items():
            posture[name] = evaluate(parse_symbol(line.text, known, line.where), angles)
        return posture


def _zero(values: Values) -> Array:
    return np.zeros(len(next(iter(values.values()))))
