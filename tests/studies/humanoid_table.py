# SPDX-License-Identifier: Apache-2.0
"""The table of calibrated humanoids, and what is asked of its numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from humanoid_trials import Calibrations

from comcal.identify.coverage import (
    PooledScore,
    QuantityScore,
    Trials,
    score_pooled,
    score_quantities,
)

FAMILY_WISE = 0.99
"""Probability that right intervals keep every coverage within its band."""
Limits = tuple[float, float]
HEAD = (
    f"{'robot':6} {'poses':>5}  {'uses':22} {'rank':>7} {'fits':>5} {'coverage %':>10} "
    f"{'outside':>8} {'RMS/bound':>10} {'chi2/dof':>8}   "
    f"{'CoM off by, mm: URDF':>20} {'calibrated':>10} {'xy':>6} {'z':>6}"
)


@dataclass(frozen=True, eq=False)
class Row:
    """One line of the table.

    Parameters
    ----------
    kind : str
        Name of the robot.
    poses : int
    use : str
        What was used, and which masses are unknown.
    calibrations : tuple of Calibrations
        Of each perturbed robot.
    nominal : tuple of array, shape (3,)
        For each of them, root mean square error of the CoM that the URDF predicts [m].
    """

    kind: str
    poses: int
    use: str
    calibrations: tuple[Calibrations, ...]
    nominal: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Check:
    """One limit and what was found."""

    what: str
    found: str
    limit: str
    passed: bool


def trials_of(row: Row) -> Iterator[Trials]:
    """Yield the calibrations of a row as those of a study, those of one rank together."""
    for size in sorted({len(c.names) for c in row.calibrations}):
        some = [c for c in row.calibrations if len(c.names) == size]
        if size == 0:
            continue
        error = np.concatenate([c.error for c in some])
        yield Trials(
            kind=f"{row.kind}, {row.poses} poses, {row.use}",
            names=some[0].names,
            units=("bound",) * size,
            error=error,
            sigma=np.concatenate([c.sigma for c in some]),
            reported=np.ones(error.shape, np.bool_),
            bound=np.ones(size),
            chi2=np.concatenate([c.chi2 for c in some]),
            dof=np.concatenate([c.dof for c in some]),
            ranks=np.concatenate([c.rank for c in some]),
        )


def table_lines(
    rows: Sequence[Row], coverage: Limits, rms_over_bound: Limits
) -> tuple[list[str], list[Check]]:
    """Return the lines of the table, and what is asked of its numbers.

    Parameters
    ----------
    rows : sequence of Row
    coverage, rms_over_bound : tuple of (float, float)
        Where the pooled numbers of every row have to lie.
    """
    every = {row: list(trials_of(row)) for row in rows}
    scores = score_quantities([t for trials in every.values() for t in trials], FAMILY_WISE)
    lines, checks = [HEAD, "-" * len(HEAD)], list[Check]()
    for row, trials in every.items():
        judged = ("",) * 5
        if trials:
            kind = trials[0].kind
            pooled = score_pooled(trials, kind)
            judged = _judged_cells(pooled, [s for s in scores if s.kind == kind])
            checks += _row_checks(pooled, coverage, rms_over_bound)
        lines.append(_line(row, judged))
    outside = [s for s in scores if not s.in_band]
    names = "; ".join(f"{s.kind}, {s.name}: {100 * s.coverage:.1f} %" for s in outside[:4])
    checks.append(
        Check(
            f"combinations outside their binomial band ({100 * FAMILY_WISE:g} % family-wise)",
            f"{len(outside)} of {len(scores)}" + (f": {names}" if names else ""),
            "0",
            not outside,
        )
    )
    return lines, checks


def _judged_cells(pooled: PooledScore, scores: Sequence[QuantityScore]) -> tuple[str, ...]:
    ranks = sorted(pooled.ranks)
    return (
        "-".join(str(r) for r in dict.fromkeys((ranks[0], ranks[-1]))),
        f"{100 * pooled.coverage:.2f}",
        f"{sum(not s.in_band for s in scores)}/{len(scores)}",
        f"{pooled.efficiency:.4f}",
        f"{pooled.chi2_per_dof:.3f}",
    )


def _row_checks(pooled: PooledScore, coverage: Limits, rms_over_bound: Limits) -> list[Check]:
    return [
        Check(
            f"{pooled.kind}: coverage of 95 % intervals",
            f"{100 * pooled.coverage:.2f} %",
            f"{100 * coverage[0]:g} to {100 * coverage[1]:g} %",
            coverage[0] <= pooled.coverage <= coverage[1],
        ),
        Check(
            f"{pooled.kind}: RMS error over Cramer-Rao bound",
            f"{pooled.efficiency:.4f} +/- {pooled.efficiency_error:.4f}",
            f"{rms_over_bound[0]:g} to {rms_over_bound[1]:g}",
            rms_over_bound[0] <= pooled.efficiency <= rms_over_bound[1],
        ),
    ]


def _line(row: Row, judged: tuple[str, ...]) -> str:
    off = np.concatenate([c.com for c in row.calibrations])
    com = 1e3 * np.sqrt(np.mean(off**2, axis=0))
    urdf = 1e3 * np.sqrt(np.mean(np.square(row.nominal), axis=0))
    rank, coverage, outside, efficiency, misfit = judged
    return (
        f"{row.kind:6} {row.poses:5d}  {row.use:22} {rank:>7} {len(off):5d} {coverage:>10} "
        f"{outside:>8} {efficiency:>10} {misfit:>8}   {np.linalg.norm(urdf):20.2f} "
        f"{np.linalg.norm(com):10.3f} {np.hypot(*com[:2]):6.3f} {com[2]:6.3f}"
    )
