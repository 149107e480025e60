# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of the CoM and of its Jacobian, as straight lines of C.

First moments are summed from the tips to the root, each turned by its joint only; what arrives is
the CoM. The Jacobian needs no origin: with g_j the first moment of all that lies beyond joint j
about that joint, over the mass of the robot, and P_j its axes in the root frame (z along the axis),

    column j = P_j (z x g_j)                turning joints
    column j = P_j z mu_j                   sliding joints

which is a_j x (s_j - M_j o_j) / M: the CoM Jacobian of Cotton 2008, of which o_j is the joint's
origin, M_j and s_j the mass and the first moment beyond it. Frames and constants are those of
:mod:`comcal.report.com_c_chain`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from comcal.report.com_c_chain import Moved, MovedChain
from comcal.report.com_c_names import in_comment
from comcal.report.com_c_terms import ZERO, Block, Term, sum_of
from comcal.robot.tree import Tree

Vector = list[Term]
"""Three components."""


@dataclass(frozen=True)
class _Beyond:
    """What the way from the tips to the root has found at every joint that moves mass."""

    g: list[Vector]
    turn: list[tuple[Term, Term]]
    """Cosine and sine of its position."""


def com_body(tree: Tree, chain: MovedChain) -> str:
    """Return the statements that set ``com[3]`` from ``q``."""
    block = Block()
    _write_com(block, tree, chain)
    return _complete(block)


def jacobian_body(tree: Tree, chain: MovedChain, n_q: str) -> str:
    """Return the statements that set ``com[3]`` and ``J[3 * n_q]`` from ``q``.

    Parameters
    ----------
    tree : Tree
    chain : MovedChain
        Of *tree*.
    n_q : str
        The number of joint positions, as C knows it.
    """
    block = Block()
    _write_jacobian(block, tree, chain, _write_com(block, tree, chain), n_q)
    return _complete(block)


def _complete(block: Block) -> str:
    text = block.text()
    return text if "q[" in text else f"    (void)q;\n{text}"


def _write_com(block: Block, tree: Tree, chain: MovedChain) -> _Beyond:
    """Write the sum from the tips to the root."""
    beyond = _Beyond([[ZERO] * 3 for _ in chain.moved], [(Term(1.0), ZERO) for _ in chain.moved])
    g = beyond.g
    known: dict[str, tuple[Term, Term]] = {}
    for i in reversed(range(len(chain.moved))):
        moved = chain.moved[i]
        block.comment(f"{_carried(tree, moved)}: {_listed(moved.links)}")
        h = _moment_on(block, chain, i, g)
        position = _position(moved)
        if moved.slides:
            g[i] = [*h[:2], block.total(f"g{i}z", [h[2], *(p * moved.share for p in position)])]
            continue
        angle = sum_of(position)
        if angle not in known:
            known[angle] = (
                block.define(f"c{i}", f"cos({angle})"),
                block.define(f"s{i}", f"sin({angle})"),
            )
        c, s = beyond.turn[i] = known[angle]
        g[i] = [
            block.total(f"g{i}x", [c * h[0], -(s * h[1])]),
            block.total(f"g{i}y", [s * h[0], c * h[1]]),
            h[2],
        ]
    block.comment(f"root: {_listed(chain.root_links)}")
    for axis, term in enumerate(_moment_on(block, chain, -1, g)):
        block.store(f"com[{axis}]", [term])
    return beyond


def _moment_on(block: Block, chain: MovedChain, body: int, g: list[Vector]) -> Vector:
    """Write h of a body: its own constant vector and what the joints on it hand down."""
    k = chain.k_root if body < 0 else chain.moved[body].k
    children = [(g[i], m.C) for i, m in enumerate(chain.moved) if m.parent == body]
    return [
        block.total(
            f"h{'' if body < 0 else body}{'xyz'[a]}",
            [Term(float(k[a])), *(gi[b] * float(C[a, b]) for gi, C in children for b in range(3))],
        )
        for a in range(3)
    ]


def _write_jacobian(block: Block, tree: Tree, chain: MovedChain, beyond: _Beyond, n_q: str) -> None:
    """Write the axes from the root to the tips, and each column once its last joint is known."""
    root = [[Term(float(a == b)) for b in range(3)] for a in range(3)]
    axes: dict[int, list[Vector]] = {-1: root}
    waiting = [sum(m.column == j for m in chain.moved) for j in range(len(tree.joint_names))]
    columns: list[list[Vector]] = [[[], [], []] for _ in waiting]
    for i, moved in enumerate(chain.moved):
        block.comment(f"column {moved.column}, {in_comment(moved.joint.name)}")
        P = [
            [
                block.total(
                    f"{'uva'[b]}{i}{'xyz'[r]}",
                    [axes[moved.parent][r][a] * float(moved.C[a, b]) for a in range(3)],
                )
                for b in range(3)
            ]
            for r in range(3)
        ]
        axes[i] = (
            P if moved.slides else [_turned(block, i, beyond.turn[i], r, P[r]) for r in range(3)]
        )
        pace = moved.joint.mimic.multiplier if moved.joint.mimic else 1.0
        gx, gy, _ = beyond.g[i]
        for r, (u, v, a) in enumerate(P):
            rate = [a * moved.share] if moved.slides else [gx * v, -(gy * u)]
            columns[moved.column][r] += [term * pace for term in rate]
        waiting[moved.column] -= 1
        if not waiting[moved.column]:
            _store_column(block, columns[moved.column], moved.column, n_q)
    idle = [j for j, column in enumerate(columns) if not column[0]]
    block.comment("joints that move no mass")
    for j in idle:
        _store_column(block, columns[j], j, n_q)


def _turned(block: Block, i: int, turn: tuple[Term, Term], r: int, row: Vector) -> Vector:
    """Write row *r* of joint *i*'s axes after it has turned about the third of them."""
    (c, s), (u, v, a) = turn, row
    return [
        block.total(f"r{i}{'xyz'[r]}", [c * u, s * v]),
        block.total(f"t{i}{'xyz'[r]}", [c * v, -(s * u)]),
        a,
    ]


def _store_column(block: Block, column: list[Vector], j: int, n_q: str) -> None:
    for r, row in enumerate(("", f"{n_q} + ", f"2 * {n_q} + ")):
        block.store(f"J[{row}{j}]", column[r])


def _position(moved: Moved) -> Vector:
    """Return the position of a joint as terms of its sum: q, or what it mimics."""
    q, mimic = Term(1.0, (f"q[{moved.column}]",)), moved.joint.mimic
    return [q] if mimic is None else [q * mimic.multiplier, Term(mimic.offset)]


def _carried(tree: Tree, moved: Moved) -> str:
    """Return which joint it is and how much hangs on it."""
    name = in_comment(moved.joint.name)
    if moved.joint.mimic:
        name += f" (mimics {in_comment(moved.joint.mimic.joint)})"
    return f"{name} moves {moved.share * tree.total_mass:.4g} kg"


def _listed(links: Sequence[str]) -> str:
    return ", ".join(map(in_comment, links))
