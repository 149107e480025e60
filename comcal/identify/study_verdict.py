# SPDX-License-Identifier: Apache-2.0
"""The summary of a study and its verdict: every number beside its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from comcal.identify.coverage import (
    PooledScore,
    QuantityScore,
    Trials,
    score_pooled,
    score_quantities,
)

ALL = "all"


@dataclass(frozen=True)
class StudyLimits:
    """What the verdict asks for.

    Parameters
    ----------
    coverage : tuple of (float, float)
        Of the pooled 95 % intervals.
    family_wise : float
        Probability that right intervals keep every quantity within its binomial band.
    rms_over_crb : float
        Largest pooled root mean square of error over Cramer-Rao bound.
    """

    coverage: tuple[float, float]
    family_wise: float
    rms_over_crb: float


@dataclass(frozen=True)
class StudyCheck:
    """One limit and what was found."""

    what: str
    found: str
    limit: str
    passed: bool


@dataclass(frozen=True)
class StudySummary:
    """Everything that a study says.

    Parameters
    ----------
    masters : tuple of int
        Master seeds.
    pooled : tuple of PooledScore
        Of every robot and noise; the last one is of all together.
    """

    name: str
    masters: tuple[int, ...]
    quantities: tuple[QuantityScore, ...]
    pooled: tuple[PooledScore, ...]
    failed: tuple[str, ...]
    checks: tuple[StudyCheck, ...]

    @property
    def passed(self) -> bool:
        """Whether every limit is met."""
        return all(check.passed for check in self.checks)


def summarise(
    name: str, masters: tuple[int, ...], trials: Sequence[Trials], limits: StudyLimits
) -> StudySummary:
    """Score the calibrations of a study and judge them by its limits.

    Parameters
    ----------
    name : str
    masters : tuple of int
        Master seeds, for the report.
    trials : sequence of Trials
        At least one of them with a result.
    limits : StudyLimits
    """
    scores = score_quantities(trials, limits.family_wise)
    whole = score_pooled(trials, ALL)
    pooled = [score_pooled([t], t.kind) for t in trials if t.error.size]
    failed = tuple(reason for t in trials for reason in t.failed)
    checks = [_coverage_check(whole, limits), _band_check(scores, limits)]
    if np.isfinite(whole.efficiency):
        checks.append(
            StudyCheck(
                "RMS error over Cramer-Rao bound, pooled",
                f"{whole.efficiency:.4f} +/- {whole.efficiency_error:.4f}",
                f"at most {limits.rms_over_crb:g}",
                whole.efficiency <= limits.rms_over_crb,
            )
        )
    checks.append(StudyCheck("calibrations without a result", str(len(failed)), "0", not failed))
    return StudySummary(name, masters, scores, (*pooled, whole), failed, tuple(checks))


def _coverage_check(whole: PooledScore, limits: StudyLimits) -> StudyCheck:
    low, high = limits.coverage
    ends = " to ".join(f"{100 * end:.2f}" for end in whole.interval)
    return StudyCheck(
        "coverage of 95 % intervals, pooled",
        f"{100 * whole.coverage:.2f} % (95 % interval {ends} %)",
        f"{100 * low:g} to {100 * high:g} %",
        low <= whole.coverage <= high,
    )


def _band_check(scores: Sequence[QuantityScore], limits: StudyLimits) -> StudyCheck:
    outside = [score for score in scores if not score.in_band]
    found = f"{len(outside)} of {len(scores)} outside"
    if outside:
        found += ": " + ", ".join(f"{score.kind} {score.name}" for score in outside)
    return StudyCheck(
        f"quantities outside their binomial band ({100 * limits.family_wise:g} % family-wise)",
        found,
        "0",
        not outside,
    )
