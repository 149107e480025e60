# SPDX-License-Identifier: Apache-2.0
"""Planted mistakes are found: the term, the kind and the correction; set COMCAL_TRIALS for more.

The mistakes are planted with Python's own syntax tree and judged with sympy; neither is used by
the checker.
"""

from __future__ import annotations

import ast
import copy
import os
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
import sympy as sp

from comcal.symbolic.check import check_claim
from comcal.symbolic.check_claim import Claim, Line
from comcal.symbolic.check_fault import FaultKind
from comcal.symbolic.check_quantities import QUANTITIES

TRIALS = int(os.environ.get("COMCAL_TRIALS", "40"))
KINDS = {
    "sign": {FaultKind.SIGN},
    "sine": {FaultKind.SINE_COSINE},
    "index": {FaultKind.INDEX},
    "dropped": {FaultKind.DROPPED, FaultKind.SEVERAL},
}
PAPER_NAMES = [
    *("m_b", "m_c", "m_w", "r_b", "r_c", "l_b", "l_c", "L_a", "L_b", "theta_b", "theta_c"),
    *("r_wb", "r_wc", "l_wb", "l_wc", "a_1", "a_2", "a_3", "a_4"),
]
EQUATIONS = {
    "moment_x_b": (
        "m_w*r_wb",
        "m_b*(l_b*sin(theta_b) + r_b*cos(theta_b))"
        " + m_c*((L_b + l_c)*sin(theta_b) + r_c*cos(theta_b))",
    ),
    "moment_z_b": (
        "m_w*(l_wb + L_a)",
        "m_b*(L_a + l_b*cos(theta_b) - r_b*sin(theta_b))"
        " + m_c*((L_b + l_c)*cos(theta_b) - r_c*sin(theta_b) + L_a)",
    ),
    "moment_x_c": ("m_w*r_wc", "m_b*r_b + m_c*(l_c*sin(theta_c) + r_c*cos(theta_c))"),
    "moment_z_c": (
        "m_w*(l_wc + L_a)",
        "m_b*(L_a + l_b) + m_c*(L_a + L_b + l_c*cos(theta_c) - r_c*sin(theta_c))",
    ),
}
A = [
    ["m_b*cos(theta_b)", "m_b*sin(theta_b)", "m_c*cos(theta_b)", "m_c*sin(theta_b)"],
    ["-m_b*sin(theta_b)", "m_b*cos(theta_b)", "-m_c*sin(theta_b)", "m_c*cos(theta_b)"],
    ["m_b", "0", "m_c*cos(theta_c)", "m_c*sin(theta_c)"],
    ["0", "m_b", "-m_c*sin(theta_c)", "m_c*cos(theta_c)"],
]
RIGHT = [
    ["m_w*r_wb - m_c*L_b*sin(theta_b)"],
    ["m_w*(l_wb + L_a) - m_b*L_a - m_c*L_b*cos(theta_b) - m_c*L_a"],
    ["m_w*r_wc"],
    ["m_w*(l_wc + L_a) - m_b*L_a - m_c*(L_a + L_b)"],
]
SOLUTIONS = ("r_b", "l_b", "r_c", "l_c")
MATRICES = {"link_com_matrix": A, "link_com_rhs": RIGHT} | {
    name: [[f"a_{r + 1}" if c == k else A[r][c] for c in range(4)] for r in range(4)]
    for k, name in enumerate(SOLUTIONS)
}


@dataclass(frozen=True)
class Planted:
    """A formula with one mistake.

    Parameters
    ----------
    mistake : str
    text : str
        The whole formula.
    term : str
        The term that is wrong, or the one that is gone.
    """

    mistake: str
    text: str
    term: str


IDENTITIES = {
    # Equations (30) and (31).
    "X_2b": "(m_w*r_wb + m_u*r_u)/m_2",
    "X_2c": "(m_w*r_wc + m_u*r_u)/m_2",
    "Z_2b": "(m_w*(l_wb + L_a) + m_u*l_u)/m_2",
    "Z_2c": "(m_w*(l_wc + L_a) + m_u*l_u)/m_2",
}


def same(a: str, b: str) -> bool:
    """Return whether two texts without ``=`` are the same function, as sympy evaluates them."""
    difference = (sp.sympify(a) - sp.sympify(b)).subs(IDENTITIES)
    names = sorted(difference.free_symbols, key=str)
    rng = np.random.default_rng(5)
    f = sp.lambdify(names, difference, "numpy")
    return bool(np.all(np.abs(f(*rng.uniform(0.3, 1.1, (len(names), 20)))) < 1e-10))


class Planter:
    """Plants mistakes by rewriting Python's syntax tree of a formula."""

    def __init__(self, rng: np.random.Generator, names: list[str]) -> None:
        self.rng = rng
        self.names = names

    def plant(self, text: str, mistake: str) -> Planted | None:
        """Return *text* with a mistake, None if there is no place for it or it changes nothing."""
        tree = ast.parse(text, mode="eval")
        terms = list(terms_of(tree, "body", tree.body))
        while terms:
            parent, field, role = terms.pop(int(self.rng.integers(len(terms))))
            work, place, name = _copied(tree, parent, field)
            term = getattr(place, name)
            gone = ast.unparse(term)
            changed = getattr(self, mistake)(work, place, name, term, role)
            if changed is None:
                continue
            new = ast.unparse(ast.fix_missing_locations(changed))
            if not same(new, text):
                return Planted(mistake, new, gone)
        return None

    def sign(self, work, place, name, term, role):
        if role == "right":
            place.op = ast.Sub() if isinstance(place.op, ast.Add) else ast.Add()
        else:
            setattr(place, name, ast.UnaryOp(ast.USub(), term))
        return work

    def dropped(self, work, place, name, term, role):
        if role == "whole":
            if any(_is_sum(n) for n in ast.walk(term)):
                return None
            setattr(place, name, ast.Constant(0))
            return work
        keep = place.left if role == "right" else place.right
        if role == "left" and isinstance(place.op, ast.Sub):
            keep = ast.UnaryOp(ast.USub(), keep)
        return _Swap(place, keep).visit(work)

    def sine(self, work, _place, _name, term, _role):
        calls = [
            n for n in own_nodes(term) if isinstance(n, ast.Call) and n.func.id in {"sin", "cos"}
        ]
        if not calls:
            return None
        call = calls[int(self.rng.integers(len(calls)))]
        call.func.id = {"sin": "cos", "cos": "sin"}[call.func.id]
        return work

    def index(self, work, _place, _name, term, _role):
        functions = {id(n.func) for n in ast.walk(term) if isinstance(n, ast.Call)}
        found = [n for n in own_nodes(term) if isinstance(n, ast.Name) and id(n) not in functions]
        if not found:
            return None
        node = found[int(self.rng.integers(len(found)))]
        stem = node.id.split("_")[0]
        others = [n for n in self.names if n.split("_")[0] == stem and n != node.id]
        if not others:
            return None
        node.id = others[int(self.rng.integers(len(others)))]
        return work


class _Swap(ast.NodeTransformer):
    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old, self.new = old, new

    def visit(self, node):
        return self.new if node is self.old else super().visit(node)


def _copied(tree, parent, field):
    """Return a deep copy of *tree* with the copy of *parent*."""
    memo = {}
    work = copy.deepcopy(tree, memo)
    return work, memo[id(parent)], field


def terms_of(parent, field, node):
    """Yield (parent, field, role) of every additive term at any depth, outermost ones first."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        yield from terms_of(node, "left", node.left)
        yield from terms_of(node, "right", node.right)
        return
    role = field if _is_sum(parent) else "whole"
    yield parent, field, role
    for child in ast.walk(node):
        if child is not node and _is_sum(child) and not _inside_sum(node, child):
            yield from terms_of(child, "left", child.left)
            yield from terms_of(child, "right", child.right)


def _is_sum(node) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)


def _inside_sum(top, node) -> bool:
    """Return whether *node* lies in a sum that lies in *top*."""
    for other in ast.walk(top):
        if other is not node and _is_sum(other) and any(n is node for n in ast.walk(other)):
            return True
    return False


def own_nodes(term):
    """Yield the nodes of a term that are in no sum inside it."""
    yield term
    for child in ast.iter_child_nodes(term):
        if not _is_sum(child):
            yield from own_nodes(child)


def chain_moment(axis, spread):
    """Return the moment of a chain of three links, relative angles, fully expanded if *spread*."""
    q = sp.symbols("q_1:4")
    pitch = [sum(q[: v + 1]) for v in range(3)]
    x, z, total_x, total_z = 0, sp.Symbol("U"), 0, 0
    for v in range(3):
        m, r, l, L = sp.symbols(f"m_{v + 1} r_{v + 1} l_{v + 1} L_{v + 1}")  # noqa: E741
        s, c = sp.sin(pitch[v]), sp.cos(pitch[v])
        total_x += m * (x + l * s + r * c)
        total_z += m * (z + l * c - r * s)
        x, z = x + L * s, z + L * c
    total = total_x if axis == "x" else total_z
    return sp.expand(sp.expand_trig(total)) if spread else sp.expand(total)


@lru_cache
def expanded_terms(axis):
    return [str(t) for t in sp.Add.make_args(chain_moment(axis, spread=True))]


def random_chain_equation(rng):
    """Return an equation of 20 or more terms in a random order, and the names in it."""
    axis = str(rng.choice(["x", "z"]))
    terms = expanded_terms(axis)
    terms = [terms[i] for i in rng.permutation(len(terms))]
    text = terms[0] + "".join(f" - {t[1:]}" if t[0] == "-" else f" + {t}" for t in terms[1:])
    left = "X_2*m_2 - m_u*r_u" if axis == "x" else "Z_2*m_2 - m_u*l_u"
    names = [f"{s}_{v}" for s in ("m", "r", "l", "L", "q") for v in (1, 2, 3)]
    return f"moment_{axis}", (left, text), [*names, "m_u", "r_u", "l_u"]


def trial(rng):
    """Return the claim, the mistake, and what the report should say."""
    while True:
        mistake = str(rng.choice(list(KINDS)))
        source = int(rng.integers(3))
        if source == 1:
            name = str(rng.choice(list(MATRICES)))
            rows = [list(row) for row in MATRICES[name]]
            r, c = int(rng.integers(len(rows))), int(rng.integers(len(rows[0])))
            original = rows[r][c]
            planted = Planter(rng, PAPER_NAMES).plant(original, mistake)
            if planted is None:
                continue
            rows[r][c] = planted.text
            lines = [[Line(t, "f:1") for t in row] for row in rows]
            return Claim(QUANTITIES[name], matrix=lines), planted, original, (r + 1, c + 1)
        if source == 0:
            name = str(rng.choice(list(EQUATIONS)))
            sides, names = EQUATIONS[name], PAPER_NAMES
        else:
            name, sides, names = random_chain_equation(rng)
        side = int(rng.random() < 0.8)
        planted = Planter(rng, names).plant(sides[side], mistake)
        if planted is None:
            continue
        wrong = (planted.text, sides[1]) if side == 0 else (sides[0], planted.text)
        links = 2 if source == 0 else 3
        claim = Claim(QUANTITIES[name], formula=Line(" = ".join(wrong), "f:1"), links=links)
        return claim, planted, f"{sides[0]} - ({sides[1]})", None


def as_difference(text):
    left, _, right = text.partition(" = ")
    return f"{left} - ({right})" if right else text


@pytest.mark.parametrize("seed", range(TRIALS))
def test_a_planted_mistake_is_found_named_and_corrected(seed):
    claim, planted, original, place = trial(np.random.default_rng(seed))
    report = check_claim(claim)
    assert len(report.wrong) == 1
    entry = report.wrong[0]
    assert entry.place == place
    assert entry.fault is not None, entry
    assert entry.fault.kind in KINDS[planted.mistake], (planted, entry.fault)
    assert same(as_difference(entry.fault.corrected), original), (planted, entry.fault)


@pytest.mark.parametrize("seed", range(4))
def test_trial_formulas_have_twenty_terms(seed):
    _, sides, _ = random_chain_equation(np.random.default_rng(seed))
    assert sum(1 + side.count(" + ") + side.count(" - ") for side in sides) >= 20
