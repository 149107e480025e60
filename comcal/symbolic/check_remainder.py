# SPDX-License-Identifier: Apache-2.0
"""What is left over when no single term explains a difference: a short sum of plain terms.

A whole bracket that was left out, or two mistakes in one formula, are found here.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from comcal.robot.tree import Array
from comcal.symbolic.check_evaluation import Evaluation
from comcal.symbolic.check_fault import FaultKind, Reading, TermFault
from comcal.symbolic.check_points import Points
from comcal.symbolic.check_vocabulary import Vocabulary, scaled, simple_factor, vocabulary
from comcal.symbolic.formula_edit import sum_paths, with_term_added
from comcal.symbolic.formula_tree import (
    Node,
    Path,
    node_at,
    product,
    symbols_of,
    term_text,
    text_of,
    with_node,
)

MOST_TERMS = 8
"""Terms of a difference that still explain something."""
_STEPS = 24
"""Terms tried, of which those that turn out to be zero are left out again."""
_EXACT = 1e-9
_NOTHING = 1e-7


def find_remainder(root: Node, points: Points, target: Array, reading: Reading) -> TermFault | None:
    """Return the few plain terms that a formula, or a bracket in it, lacks or has too many.

    Parameters
    ----------
    root : Node
        A formula that no single change makes agree.
    points : Points
    target : array, shape (count,)
        What it should be; zero for an equation.
    reading : Reading

    Returns
    -------
    TermFault or None
        None if the difference is not a short sum.

    Notes
    -----
    Orthogonal matching pursuit: the term most like what is left is taken, all terms taken are
    fitted again, and so on until nothing is left.
    """
    at = Evaluation(root, points.values, target)
    used = symbols_of(root)
    # What is computed from other symbols may be the shortest way to say it, or stand in the way.
    words = [
        vocabulary(points, used, [*reading.exclude, *less], most_angles=1)
        for less in ((), points.derived)
    ]
    # Of an equation, the right side is completed rather than the left one.
    for path in sorted(sum_paths(root, ()), key=lambda p: (len(p) > 1, [-i for i in p[:1]])):
        wanted = at.wanted(path)
        if wanted is None:
            continue
        sums = (_pursued(wanted - at.at(path), w) for w in words)
        for lacking in sorted((found for found in sums if found), key=len):
            new = node_at(root, path)
            for factor, term in lacking:
                new = with_term_added(new, scaled(factor, term), negative=factor < 0)
            corrected = with_node(root, path, new)
            right = Evaluation(corrected, points.values, target).agrees()
            if right and reading.still_says(corrected):
                return _described(root, path, new, len(lacking), corrected, reading)
    return None


def _described(
    root: Node, path: Path, new: Node, count: int, corrected: Node, reading: Reading
) -> TermFault:
    names = reading.names
    start = len(new.children) - count
    added = [term_text(new, i, names, plus=True) for i in range(start, len(new.children))]
    text = " ".join(f"{t[0]} {t[1:]}" for t in added)
    whole = len(path) == (root.op == "equation")
    within = "" if whole else text_of(node_at(root, path), names)
    return TermFault(FaultKind.SEVERAL, "", within, text, text_of(corrected, names))


def _pursued(difference: Array, words: Vocabulary) -> list[tuple[Fraction, Node]]:
    if not np.all(np.isfinite(difference)) or not np.any(difference):
        return []
    size = np.linalg.norm(words.values, axis=1)
    unit = words.values / size[:, None]
    left, chosen = difference, list[int]()
    goal = _EXACT * float(np.linalg.norm(difference))
    fitted = np.zeros(0)
    while np.linalg.norm(left) > goal and len(chosen) < min(_STEPS, difference.size // 4):
        likeness = np.abs(unit @ left)
        likeness[chosen] = 0.0
        chosen.append(int(np.argmax(likeness)))
        fitted = np.linalg.lstsq(unit[chosen].T, difference, rcond=None)[0]
        left = difference - fitted @ unit[chosen]
    if np.linalg.norm(left) > goal:
        return []
    found: list[tuple[Fraction, Node]] = []
    for k, value in sorted(zip(chosen, fitted / size[chosen], strict=True)):
        factor = simple_factor(np.array([value]), tolerance=_NOTHING)
        if abs(value) < _NOTHING or not words.words[k]:
            continue
        if factor is None:
            return []
        found.append((factor, product(*words.words[k])))
    return found if len(found) <= MOST_TERMS else []
