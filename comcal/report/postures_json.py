# SPDX-License-Identifier: Apache-2.0
"""The result of a fitted chain as plain data for ``result.json`` (format ``comcal-result/1``)."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any

from comcal.identify.convention_ranking import ScoredConvention
from comcal.identify.postures import PosturesResult, Usability


def postures_json(result: PosturesResult) -> dict[str, Any]:
    """Return the result as dicts, lists, numbers and strings; SI and radians.

    Keys that a chain without masses cannot fill (``mass``, ``links`` ...) are left out. What is
    infinite or not a number is null.

    Parameters
    ----------
    result : PosturesResult
    """
    fit, ranking = result.fit, result.ranking
    usable = result.usability is Usability.USABLE
    return {
        "format": "comcal-result/1",
        "verdict": "no_limits" if usable else "not_identifiable",
        "verdict_in_words": result.verdict,
        "rank": fit.rank,
        "unknowns": fit.unknowns,
        "condition": _number(fit.condition),
        "chi2": _number(fit.chi2),
        "dof": fit.dof,
        "held_out": {
            "com_rms_mm": _number(1e3 * result.held_out_rms),
            "poses": [
                {
                    "pose": p.pose,
                    "component": p.component,
                    "predicted": _number(p.predicted),
                    "half_width": _number(p.half_width),
                    "rounding": [_number(end) for end in p.rounding],
                    "conventions": [_number(end) for end in p.conventions],
                    "measured": _number(p.measured),
                }
                for p in result.predictions
            ],
        },
        "sesc": {
            "labels": list(result.labels),
            "r": [_number(value) for value in fit.r],
            "cov": [[_number(value) for value in row] for row in fit.cov],
            "scale": _number(fit.scale),
            "leave_one_out": [_number(value) for value in fit.left_out],
            "poses": list(result.fitted),
        },
        "conventions": {
            "chosen": _scored(ranking.chosen, result.columns),
            "tied": [_scored(s, result.columns) for s in ranking.tied],
            "tried": len(ranking.scored),
            "two_feet": list(ranking.two_feet),
            "rounding": asdict(result.conventions.rounding),
            "draws": ranking.draws,
            "seed": result.seed,
        },
    }


def _scored(scored: ScoredConvention, columns: tuple[str, ...]) -> dict[str, Any]:
    """Return one reading and its scores."""
    convention = scored.convention
    return {
        "order": convention.order,
        "columns": [columns[c] for c in convention.columns],
        "signs": list(convention.signs),
        "offset": convention.offset.value,
        "unknowns": scored.unknowns,
        "dof": scored.dof,
        "leave_one_out_rms": _number(scored.left_out_rms),
        "leave_one_out_median": _number(scored.left_out_median),
        "beats_best": _number(scored.beats_best),
        "gap_rms": _number(scored.gap_rms),
        "gap_p": _number(scored.gap_p),
    }


def _number(value: float) -> float | None:
    """Return a float that JSON can hold, or None."""
    return float(value) if isfinite(value) else None
