# SPDX-License-Identifier: Apache-2.0
"""Choose how to read a table of joint angles, from the poses that are fitted alone.

Two things can speak. *Closure*: in a pose on both feet the loop through both legs closes, so the
other foot is parallel to the root. *Leave-one-out*: the right reading predicts a left-out pose
better than a wrong one. With few degrees of freedom a leave-one-out error of the printed numbers is
mostly luck: some wrong reading always fits. Every score is therefore the median over many tables
that would have been rounded to the printed one, and a reading is distinguishable from the best
only if it loses on nearly all of them.

Nothing here ever receives a held-out pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isnan, nan

import numpy as np

from comcal.errors import RankError
from comcal.identify.closure import feet_gap, on_both_feet
from comcal.identify.conventions import (
    Convention,
    Conventions,
    Rounding,
    convention_matrix,
    same_models,
)
from comcal.identify.known_com import KnownCom
from comcal.identify.sesc_fit import count_unknowns, left_out_errors
from comcal.robot.tree import Array, Tree
from comcal.statics.sesc import SescChain

REFUTED = 0.05
"""A reading is refuted if its loops would gape this much by chance less often than this."""
TIED = 0.05
"""A reading is distinguishable from the best if it beats it on a smaller share of the tables."""
_CLOSURE_STEP = np.radians(0.1)
"""Gaps closer together than this count as equal."""


@dataclass(frozen=True)
class ScoredConvention:
    """A reading of the table and how well the fitted poses agree with it.

    Parameters
    ----------
    convention : Convention
    aliases : tuple of Convention
        Other candidates that are the same model.
    unknowns, rank, dof : int
        Columns, how many of them the poses determine, equations minus rank.
    left_out_rms : float
        Leave-one-out error of the table as printed [m].
    left_out_median : float
        Median of it over the rounding [m]: the score.
    beats_best : float
        Share of the tables on which it does better than the best score.
    gap_rms : float
        Angle between the two feet over the poses on both [rad]; NaN where there is none.
    gap_p : float
        How often chance alone would make gaps as large; NaN where there is none.
    """

    convention: Convention
    aliases: tuple[Convention, ...]
    unknowns: int
    rank: int
    dof: int
    left_out_rms: float
    left_out_median: float
    beats_best: float
    gap_rms: float
    gap_p: float

    @property
    def is_refuted(self) -> bool:
        """Whether the feet are not parallel where they must be."""
        return not isnan(self.gap_p) and self.gap_p < REFUTED

    @property
    def is_tied(self) -> bool:
        """Whether the fitted poses cannot tell it from the best."""
        return not self.is_refuted and self.beats_best >= TIED


@dataclass(frozen=True)
class Ranking:
    """All readings, best first.

    Parameters
    ----------
    scored : tuple of ScoredConvention
        Tied ones first (smallest gap, then smallest leave-one-out median), then distinguishable
        ones, then refuted ones.
    two_feet : tuple of int
        Ids of the fitted poses that stand on both feet.
    n_candidates : int
        Candidates before equal models were merged.
    draws : int
        Tables drawn within the rounding.
    """

    scored: tuple[ScoredConvention, ...]
    two_feet: tuple[int, ...]
    n_candidates: int
    draws: int

    @property
    def chosen(self) -> ScoredConvention:
        """The reading that is used and named."""
        return self.scored[0]

    @property
    def tied(self) -> tuple[ScoredConvention, ...]:
        """The chosen one and those that the fitted poses cannot tell from the best."""
        return tuple(s for s in self.scored if s.is_tied)

    @property
    def closure_separates(self) -> bool:
        """Whether the loops refute any reading."""
        return any(s.is_refuted for s in self.scored)


def rank_conventions(
    chain: SescChain,
    conventions: Conventions,
    fitting: KnownCom,
    rng: np.random.Generator,
    draws: int = 200,
) -> Ranking:
    """Score every convention by the fitting poses alone.

    Parameters
    ----------
    chain : SescChain
    conventions : Conventions
    fitting : KnownCom
        The poses to fit; held-out ones must not be among them.
    rng : numpy.random.Generator
    draws : int
        Tables drawn within the rounding.

    Returns
    -------
    Ranking

    Raises
    ------
    RankError
        If under no convention a left-out pose can be predicted from the others.
    """
    candidates = conventions.candidates()
    q, com = draw_tables(chain.tree, conventions.rounding, fitting, rng, draws)
    scores: list[tuple[ScoredConvention, Array]] = []
    for group in same_models(chain, candidates, fitting):
        rows = fitting.pick(convention_matrix(chain, group[0], fitting.q))
        unknowns, rank = count_unknowns(rows)
        printed = _rms(left_out_errors(rows, fitting.com))
        drawn = left_out_errors(fitting.pick(convention_matrix(chain, group[0], q)), com)
        gap_rms, gap_p = feet_gap(chain.tree, conventions, group[0], fitting.q)
        rms = _rms(drawn)
        scored = ScoredConvention(
            convention=group[0],
            aliases=group[1:],
            unknowns=unknowns,
            rank=rank,
            dof=len(fitting) - rank,
            left_out_rms=float(printed),
            left_out_median=float(np.median(rms)),
            beats_best=nan,
            gap_rms=gap_rms,
            gap_p=gap_p,
        )
        scores.append((scored, rms))
    ranked = _compare(scores)
    two_feet = on_both_feet(chain.tree, conventions.closure, ranked[0].convention, fitting.q)
    return Ranking(
        scored=ranked,
        two_feet=tuple(fitting.pose[i] for i in np.flatnonzero(two_feet)),
        n_candidates=len(candidates),
        draws=draws,
    )


def draw_tables(
    tree: Tree, rounding: Rounding, known: KnownCom, rng: np.random.Generator, draws: int
) -> tuple[Array, Array]:
    """Draw tables that differ from the given one by no more than is unknown about it.

    Uniformly within the rounding where a rounding is stated, else by the standard errors.

    Returns
    -------
    q : array, shape (draws, N, n_joints)
    com : array, shape (draws, n_eq)
    """
    q = known.q + _errors(rounding.of_joints(tree), known.q_var, rng, draws)
    com = known.com + _errors(np.asarray(rounding.length), known.com_var, rng, draws)
    return q, com


def _errors(half_width: Array, variance: Array, rng: np.random.Generator, draws: int) -> Array:
    """Return one error for every cell, shape (draws, *variance.shape)."""
    shape = (draws, *variance.shape)
    uniform = rng.uniform(-1.0, 1.0, shape) * half_width
    normal = rng.standard_normal(shape) * np.sqrt(variance)
    return np.where(half_width > 0.0, uniform, normal)


def _compare(scores: list[tuple[ScoredConvention, Array]]) -> tuple[ScoredConvention, ...]:
    """Return the conventions in order, each with the share of tables on which it beats the best."""
    open_to_choice = [pair for pair in scores if not pair[0].is_refuted] or scores
    best, best_rms = min(open_to_choice, key=lambda pair: pair[0].left_out_median)
    if not np.isfinite(best.left_out_median):
        raise RankError(
            "no pose can be predicted from the others, however the columns are read",
            measured=f"{best.unknowns} unknowns, {best.dof} degrees of freedom",
            next_step="record more poses, or give a chain with fewer joints",
        )
    ranked = [
        replace(scored, beats_best=1.0 if scored is best else float(np.mean(rms <= best_rms)))
        for scored, rms in scores
    ]

    def place(s: ScoredConvention) -> tuple[bool, bool, int, float]:
        gap = 0 if isnan(s.gap_rms) else round(s.gap_rms / _CLOSURE_STEP)
        return (s.is_refuted, not s.is_tied, gap, s.left_out_median)

    return tuple(sorted(ranked, key=place))


def _rms(errors: Array) -> Array:
    """Return the root mean square over the last axis."""
    return np.sqrt(np.mean(errors**2, axis=-1))
