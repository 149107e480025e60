# SPDX-License-Identifier: Apache-2.0
"""A study in words and numbers, as text and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from comcal.identify.coverage import PooledScore, QuantityScore
from comcal.identify.study_verdict import StudySummary

FAILURES_SHOWN = 5


def study_lines(summary: StudySummary) -> list[str]:
    """Return the report of a study, one string per line; lengths in mm, masses in g.

    Parameters
    ----------
    summary : StudySummary
    """
    whole = summary.pooled[-1]
    masters = ", ".join(map(str, summary.masters))
    head = f"{summary.name}: {whole.calibrations} calibrations, master seeds {masters}"
    lines = [head, "", *_quantity_lines(summary.quantities), "", *_pooled_lines(summary.pooled)]
    lines += [f"failed: {reason}" for reason in summary.failed[:FAILURES_SHOWN]]
    if len(summary.failed) > FAILURES_SHOWN:
        lines.append(f"and {len(summary.failed) - FAILURES_SHOWN} more that failed")
    lines.append("")
    lines += [
        line
        for check in summary.checks
        for line in (
            f"{'ok' if check.passed else 'FAILED':<6}  {check.what}: {check.found}",
            f"{'':<6}  limit {check.limit}",
        )
    ]
    lines += ["", f"Verdict: {verdict_word(summary)}."]
    return lines


def verdict_word(summary: StudySummary) -> str:
    """Return ``passed`` or ``failed``."""
    return "passed" if summary.passed else "failed"


def study_as_json(summary: StudySummary) -> dict[str, Any]:
    """Return the whole summary as plain data; what is not a number is null.

    Parameters
    ----------
    summary : StudySummary
    """
    return {
        "format": "comcal-study-summary/1",
        "name": summary.name,
        "verdict": verdict_word(summary),
        "master_seeds": list(summary.masters),
        "checks": [asdict(check) for check in summary.checks],
        "pooled": [_finite(asdict(score)) for score in summary.pooled],
        "quantities": [
            {**_finite(asdict(score)), "in_band": score.in_band} for score in summary.quantities
        ],
        "failed": list(summary.failed),
    }


def _quantity_lines(scores: Sequence[QuantityScore]) -> list[str]:
    lines: list[str] = []
    kind = ""
    width = max(len(score.name) for score in scores)
    for score in scores:
        if score.kind != kind:
            kind = score.kind
            low, high = score.band
            lines += [
                *([""] if lines else []),
                f"{kind}: {score.n} calibrations; coverage of 95 % intervals should be "
                f"{100 * low:.2f} to {100 * high:.2f} %",
                f"  {'':<{width}}  {'RMS error':>12}  {'/ bound':>7}  {'bias':>6}  coverage",
            ]
        size = f"{1e3 * score.rms:.4f} {'g ' if score.unit == 'kg' else 'mm'}"
        ratio = "" if math.isnan(score.efficiency) else f"{score.efficiency:.4f}"
        note = "" if score.in_band else "  OUTSIDE"
        if score.withheld:
            note += f"  not reported in {100 * score.withheld:.2f} %"
        lines.append(
            f"  {score.name:<{width}}  {size:>12}  {ratio:>7}  {score.bias:>+6.2f}  "
            f"{100 * score.coverage:.2f} %{note}"
        )
    lines.append(
        "(/ bound: over the Cramer-Rao bound; bias: mean error in units of its own standard error)"
    )
    return lines


def _pooled_lines(pooled: Sequence[PooledScore]) -> list[str]:
    lines: list[str] = []
    for score in pooled:
        ends = " to ".join(f"{100 * end:.2f}" for end in score.interval)
        ranks = ", ".join(f"{rank} ({n})" for rank, n in sorted(score.ranks.items()))
        quality = f"  chi2 / dof {score.chi2_per_dof:.4f}, rank {ranks}"
        if not math.isnan(score.efficiency):
            quality += f", RMS / bound {score.efficiency:.4f} +/- {score.efficiency_error:.4f}"
        lines += [
            f"{score.kind}: {score.intervals} intervals of {score.calibrations} calibrations, "
            f"{100 * score.coverage:.2f} % hold the truth ({ends} %)",
            quality,
        ]
    return lines


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }
