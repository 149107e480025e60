# SPDX-License-Identifier: Apache-2.0
"""How residuals follow a wrench on any link, all links at once, without moving anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.measure.table import PoseTable
from comcal.predict.assumed import Assumed
from comcal.predict.parity import Parity, placed
from comcal.predict.standing import world_axes
from comcal.robot.frames import cross
from comcal.robot.tree import Array
from comcal.statics.balance import Balance
from comcal.statics.cut_rows import Cut, cuts_of
from comcal.statics.moves import moves_of

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@dataclass(frozen=True)
class LinkLoads:
    """Columns of wrenches on links.

    Parameters
    ----------
    by_weight : array, shape (n, n_links, 4)
        Of a mass at the origin of each link [1/kg], and of first moments in its frame [1/(kg m)].
    by_force, by_couple : array, shape (n, n_links, 3)
        Of a force at its origin [1/N], and of a couple [1/(N m)], in axes of P; of a hanging
        robot, in axes of the world.
    R_link_P : array, shape (N, n_links, 3, 3)
        Those axes in each link, pose by pose.
    """

    by_weight: Array
    by_force: Array
    by_couple: Array
    R_link_P: Array


def link_loads(assumed: Assumed, table: PoseTable, at: Parity) -> LinkLoads:
    """Return how the residuals follow masses of, and forces on, all links.

    Parameters
    ----------
    assumed : Assumed
    table : PoseTable
    at : Parity
        The residuals of both.
    """
    n_links, g = len(assumed.robot.tree.links), assumed.robot.gravity
    by_weight = np.zeros((len(at.values), n_links, 4))
    by_force = np.zeros((len(at.values), n_links, 3))
    by_couple = np.zeros((len(at.values), n_links, 3))
    R_link_P = np.zeros((len(table), n_links, 3, 3))
    supports = np.array(table.support)[at.pose]
    for support in sorted(set(table.support)):
        block = np.flatnonzero(supports == support)
        if not block.size:
            continue
        index = np.unique(at.pose[block])
        balance, carrier, standing = placed(assumed, table.select(index), support)
        R, p, f = balance.placements.R, balance.placements.p, balance.direction[:, None]
        P = world_axes(balance.direction), np.zeros((len(index), 3))
        if standing is not None:
            P = standing.R_root_P, standing.p_root_P
        R_link_P[index] = np.nan_to_num(np.swapaxes(R, 2, 3) @ P[0][:, None])
        rows = [at.row[i] for i in block[: len(block) // len(index)]]
        cuts = {cut.sensor: cut for cut in cuts_of(assumed.robot, carrier)}
        felt = _felt(balance, P, cuts, [(row.kind, row.of, row.axis) for row in rows])
        weight = -g * np.broadcast_to(f, p.shape)
        down = np.concatenate([weight, cross(p, weight)], axis=-1)
        by_weight[block, :, 0] = _rows(felt, down)
        for i in range(3):
            turned = np.concatenate([np.zeros(p.shape), cross(R[..., i], weight)], axis=-1)
            by_weight[block, :, 1 + i] = _rows(felt, turned)
            along = np.broadcast_to(P[0][:, None, :, i], p.shape)
            pull = np.concatenate([along, cross(p, along)], axis=-1)
            by_force[block, :, i] = _rows(felt, pull)
            couple = np.concatenate([np.zeros(p.shape), along], axis=-1)
            by_couple[block, :, i] = _rows(felt, couple)
    return LinkLoads(by_weight, by_force, by_couple, R_link_P)


def _rows(felt: Array, wrench: Array) -> Array:
    """Return what rows feel of a wrench on each link, (N, k, n_links, 6) by (N, n_links, 6)."""
    found = np.einsum("nkli,nli->nkl", felt, wrench).reshape(-1, wrench.shape[1])
    # Of a link whose place is not known: rows that feel it have no value, the others feel nothing.
    return np.nan_to_num(found)


def _felt(
    balance: Balance,
    P: tuple[Array, Array],
    cuts: dict[str, Cut],
    rows: list[tuple[str, str, str]],
) -> Array:
    """Return d(row)/d(wrench on a link, about the root), shape (N, k, n_links, 6)."""
    carried = balance.carrier.carried.astype(np.float64)
    felt = np.zeros((len(balance.q), len(rows), len(carried), 6))
    moves, drive = moves_of(balance), balance.motion.drive
    # Of a joint: - a . (M - o x F) of what lies beyond it, taken off the measured torque.
    lever = np.concatenate([cross(moves.axis, moves.origin), -moves.axis], axis=-1)
    along = np.concatenate([-moves.axis, np.zeros(moves.axis.shape)], axis=-1)
    lever = np.where(moves.slides, along, lever)
    names = balance.robot.tree.joint_names
    for r, (kind, of, axis) in enumerate(rows):
        if kind == "equilibrium":
            felt[:, r] = _component(*P, axis)[:, None] * carried[:, None]
        elif kind == "sensor":
            cut = cuts[of]
            at = balance.placements
            about = _component(at.R[:, cut.link], at.p[:, cut.link], axis)
            felt[:, r] = -about[:, None] * cut.below[:, None]
        elif kind == "torque":
            held = drive[:, names.index(of)][:, None] * (moves.beyond * carried)
            felt[:, r] = -np.einsum("nmi,ml->nli", lever, held)
    return felt


def _component(R: Array, p: Array, axis: str) -> Array:
    """Return the row that takes one component of a wrench about the root to a frame, (N, 6)."""
    k = AXES.index(axis)
    e = R[..., k % 3]
    if k < 3:
        return np.concatenate([e, np.zeros(e.shape)], axis=-1)
    # e . (M - p x F) = e . M - (e x p) . F
    return np.concatenate([-cross(e, p), e], axis=-1)
