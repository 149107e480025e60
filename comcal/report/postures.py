# SPDX-License-Identifier: Apache-2.0
"""Text of a chain fitted to known CoM components: what was chosen, how far it can be trusted."""

from __future__ import annotations

from collections import Counter
from math import degrees, isnan

import numpy as np

from comcal.identify.convention_ranking import Ranking, ScoredConvention
from comcal.identify.conventions import Convention, Offset
from comcal.identify.postures import PosePrediction, PosturesResult

_SHOWN = 5
"""Tied readings listed by name."""
_LARGEST_MM = 99_999.0


def postures_lines(result: PosturesResult) -> list[str]:
    """Return the report of a fitted chain, one string per line, lengths in mm.

    Parameters
    ----------
    result : PosturesResult
    """
    return [
        f"{result.robot}: CoM by the statically equivalent serial chain",
        "",
        *_reading_lines(result),
        "",
        *_fit_lines(result),
        *(["", *_prediction_lines(result.predictions)] if result.predictions else []),
        "",
        *([*_tied_lines(result.ranking), ""] if len(result.ranking.tied) > 1 else []),
        f"Verdict: {result.verdict}.",
        f"(seed {result.seed})",
    ]


def _reading_lines(result: PosturesResult) -> list[str]:
    """Say how the columns are read and what spoke for it."""
    ranking = result.ranking
    best = ranking.chosen
    names = result.columns
    width = max(len(name) for name in names)
    lines = [f"Reading of the table, chosen by the fitted poses alone: {best.convention.order}"]
    for column, name in enumerate(names):
        joint = best.convention.columns.index(column)
        sign = "+" if best.convention.signs[joint] > 0 else "-"
        lines.append(f"  {name:<{width}} = {sign} {result.conventions.words[joint]}")
    lines.append(f"  CoM counted from {_origin(best.convention)}")
    n_models, n_tied = len(ranking.scored), len(ranking.tied)
    merged = ranking.n_candidates - n_models
    same = f" ({merged} more are the same model by another name)" if merged else ""
    if ranking.n_candidates > 1:
        lines.append(f"  {n_models} readings tried{same}; {n_tied} cannot be told from the best")
        lines.append(f"  what is left to check them with: {_counts(ranking)}")
    lines.append(
        f"  leave-one-out error {_mm(best.left_out_rms)} mm with the numbers as given, "
        f"{_mm(best.left_out_median)} mm in the middle of {ranking.draws} tables within their error"
    )
    if ranking.two_feet:
        poses = " ".join(map(str, ranking.two_feet))
        separates = "refutes some readings" if ranking.closure_separates else "refutes no reading"
        lines.append(
            f"  closure: poses {poses} stand on both feet, which are then "
            f"{degrees(best.gap_rms):.1f} deg from parallel (p = {best.gap_p:.2f}); {separates}"
        )
    elif result.conventions.closure is not None:
        lines.append("  closure: no fitted pose stands on both feet")
    return lines


def _fit_lines(result: PosturesResult) -> list[str]:
    """Say how much the poses determine."""
    fit = result.fit
    sigma = np.sqrt(np.diag(fit.cov))
    worst = int(np.argmax(np.abs(fit.r)))
    lines = [
        f"Fit to {len(result.fitted)} poses ({' '.join(map(str, result.fitted))})",
        f"  {fit.unknowns} unknowns, rank {fit.rank}, {fit.dof} degrees of freedom, "
        f"condition {fit.condition:.0f}",
        f"  error of one equation: {_mm(float(np.median(fit.sigma)))} mm known beforehand, "
        f"times {fit.scale:.2f} from the residuals; 95 % = {fit.quantile():.1f} sigma",
    ]
    if fit.rank < fit.unknowns:
        lines.append("  R itself is not determined; only CoM predictions are")
    lines.append(
        f"  largest entry of R: {result.labels[worst]} = {_mm(float(fit.r[worst]))} "
        f"+/- {_mm(fit.quantile() * float(sigma[worst]))} mm"
    )
    return lines


def _prediction_lines(predictions: tuple[PosePrediction, ...]) -> list[str]:
    """Tabulate predictions, their intervals, their spreads, and the measurements last."""
    head = (
        f"  {'pose':>4}    {'predicted':>9}  {'+/- 95 %':>8}  {'over rounding':>15}  "
        f"{'over readings':>15}  {'measured':>8} {'error':>6}"
    )
    lines = ["Held-out poses [mm]; what was measured is compared last and enters nothing", head]
    lines += [
        f"  {p.pose:>4} {p.component}  {_mm(p.predicted):>9}  {_mm(p.half_width):>8}  "
        f"{_range(p.rounding):>15}  {_range(p.conventions):>15}  {_mm(p.measured):>8} "
        f"{_mm(p.error):>6}"
        for p in predictions
    ]
    inside = sum(p.is_inside for p in predictions)
    lines.append(f"  {inside} of {len(predictions)} measurements lie inside their interval")
    return lines


def _tied_lines(ranking: Ranking) -> list[str]:
    """List the readings next to the chosen one, and how many more there are."""
    lines = ["Readings that cannot be told apart (leave-one-out median, gap between the feet)"]
    lines += [
        f"  {_mm(s.left_out_median):>6} mm{_gap(s)}  {_spell(s)}" for s in ranking.tied[:_SHOWN]
    ]
    more = len(ranking.tied) - _SHOWN
    return [*lines, f"  and {more} more"] if more > 0 else lines


def _spell(scored: ScoredConvention) -> str:
    """Return a reading in one line."""
    convention = scored.convention
    signs = "".join("+" if s > 0 else "-" for s in convention.signs)
    return (
        f"{convention.order}, signs {signs}, offset {convention.offset.value}, "
        f"{scored.unknowns} unknowns, {scored.dof} left"
    )


def _counts(ranking: Ranking) -> str:
    """Say how many unknowns and degrees of freedom the readings have."""
    counts = Counter((s.unknowns, s.dof) for s in ranking.scored)
    return ", ".join(
        f"{unknowns} unknowns and {dof} degree{'s' if dof != 1 else ''} of freedom ({n})"
        for (unknowns, dof), n in sorted(counts.items())
    )


def _gap(scored: ScoredConvention) -> str:
    """Return the gap between the feet, or nothing where no pose shows one."""
    return "" if isnan(scored.gap_rms) else f" {degrees(scored.gap_rms):4.1f} deg"


def _origin(convention: Convention) -> str:
    """Say where the CoM is counted from."""
    if convention.offset is Offset.ZERO:
        return "the first joint of the chain"
    return "a point that is fitted too"


def _range(ends: tuple[float, float]) -> str:
    """Return ``low .. high`` in mm."""
    return f"{_mm(ends[0])} .. {_mm(ends[1])}"


def _mm(length: float) -> str:
    """Return a length [m] in mm; what is not known or absurdly large is said so."""
    if isnan(length):
        return "?"
    value = 1e3 * length
    if abs(value) > _LARGEST_MM:
        return ">1e5" if value > 0 else "<-1e5"
    return f"{value:.1f}"
