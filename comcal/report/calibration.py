# SPDX-License-Identifier: Apache-2.0
"""The text report of a calibration: what a person reads after ``comcal solve``."""

from __future__ import annotations

import numpy as np
from rich.console import Console

from comcal.identify.calibration import MISFIT, Calibration, Check, Verdict
from comcal.identify.paper_route import PaperRoute
from comcal.identify.solution import LinkCom, Solution, sigmas
from comcal.report.consistent import print_consistent
from comcal.report.console import print_lines, print_table
from comcal.report.numbers import plus_minus as _pm
from comcal.report.other_cuts import print_other_cuts
from comcal.report.prior import print_prior
from comcal.report.with_torques import print_with_and_without

MM = 1e3
EXCESS = 2.0
"""A mass further from the URDF's than this many sigmas is an excess or a lack."""
_UNIT = {"m": (1e3, "mm"), "kg": (1.0, "kg")}


def print_calibration(console: Console, calibration: Calibration) -> None:
    """Print everything a calibration says, ending in its verdict.

    Parameters
    ----------
    console : Console
    calibration : Calibration
    """
    notes = (*calibration.table.notes, *calibration.notes)
    print_lines(console, (f"note: {note}" for note in notes))
    _coefficients(console, calibration)
    if calibration.paper is not None:
        _paper(console, calibration.paper)
    if calibration.solution is not None:
        _solution(console, calibration.solution)
    if calibration.without_torques is not None and calibration.solution is not None:
        print_with_and_without(console, calibration.solution, calibration.without_torques)
    _difference(console, calibration)
    _mass(console, calibration)
    if calibration.with_prior is not None:
        print_prior(console, calibration.with_prior)
    if calibration.consistent is not None:
        print_consistent(console, calibration.consistent)
    console.print()
    print_verdict(console, calibration)


def print_verdict(console: Console, calibration: Calibration) -> None:
    """Print the one verdict, each limit beside what was measured."""
    words = {
        Verdict.PASSED: "PASSED",
        Verdict.FAILED: "FAILED",
        Verdict.NO_LIMITS: f"NO LIMITS JUDGED: {calibration.reason}"
        if calibration.reason
        else "NO LIMITS SET (robot.yaml: limits)",
        Verdict.NOT_IDENTIFIABLE: f"NOT IDENTIFIABLE: {calibration.reason}",
    }
    print_lines(console, [f"Verdict: {words[calibration.verdict]}"], style="bold")
    print_lines(console, (f"  {_check(check)}" for check in calibration.checks))


def _check(check: Check) -> str:
    factor, unit = _UNIT[check.unit]
    sign = "<=" if check.passed else ">"
    measured, limit = check.measured * factor, check.limit * factor
    return f"{check.name}: {measured:.3g} {unit} {sign} {limit:.3g} {unit}"


def _heading(console: Console, text: str) -> None:
    console.print()
    print_lines(console, [text], style="bold")


def _coefficients(console: Console, calibration: Calibration) -> None:
    coefficients = calibration.coefficients
    if coefficients is None:
        return
    _heading(
        console, "Line of gravity in P: X = alpha + beta Z, Y = gamma + delta Z (carried mass)"
    )
    rows = [
        (
            str(calibration.table.pose[row]),
            calibration.table.configuration[row] or "-",
            _pm(v[0], s[0], MM),
            _pm(v[1], s[1], 1e3),
            _pm(v[2], s[2], MM),
            _pm(v[3], s[3], 1e3),
            _pm(m, ms),
        )
        for row, v, s, m, ms in zip(
            coefficients.rows,
            coefficients.values,
            coefficients.sigma,
            coefficients.mass,
            coefficients.mass_sigma,
            strict=True,
        )
    ]
    header = ("pose", "shape", "alpha mm", "beta 1e-3", "gamma mm", "delta 1e-3", "carried kg")
    print_table(console, rows, header)


def _paper(console: Console, paper: PaperRoute) -> None:
    _heading(
        console, "The paper's route: total CoM of each shape, whole robot in P, reference pose"
    )
    print_lines(console, (f"refused: {error}" for error in paper.refused))
    if paper.totals:
        rows = []
        for t in paper.totals:
            sd, cad = sigmas(t.cov), sigmas(t.cov_cad)
            tilt = "-" if np.isnan(t.tilt) else f"{np.rad2deg(t.tilt):.1f}"
            rows.append(
                (
                    t.configuration.name,
                    t.by,
                    tilt,
                    *(_pm(x, s, MM) for x, s in zip(t.xyz, sd, strict=True)),
                    f"{cad[0] * MM:.2f}, {cad[2] * MM:.2f}",
                )
            )
        print_table(
            console, rows, ("shape", "by", "tilt deg", "x mm", "y mm", "z mm", "CAD adds x, z mm")
        )
    if paper.chain is None:
        print_lines(console, [f"Cramer's rule does not apply: {paper.reason}"])
        return
    names = [t.configuration.name for t in paper.totals]
    _heading(
        console,
        "Cramer's rule: CoM of each segment from its joint nearer the feet, l up, r to the toes",
    )
    rows = []
    for k, result in enumerate(paper.choices):
        sd = sigmas(result.cov)
        solving = ", ".join(names[i] for i in result.choice.solving)
        for v, segment in enumerate(paper.chain.segments):
            r, l = 2 * v, 2 * v + 1  # noqa: E741 - the paper's letter
            rows.append(
                (
                    solving + (" (best)" if k == 0 else "") if v == 0 else "",
                    f"{result.choice.determinant:.3f}" if v == 0 else "",
                    segment.name(paper.chain.robot),
                    _pm(result.w[v].imag, sd[r], MM),
                    _pm(result.w[v].real, sd[l], MM),
                    f"{result.noise_gain[r]:.1f}, {result.noise_gain[l]:.1f}",
                    _misfit(result.misfit, result.misfit_sigma) if v == 0 else "",
                )
            )
    print_table(
        console,
        rows,
        ("solved from", "|det E|", "segment", "r mm", "l mm", "gain r, l", "rest off x, z mm"),
    )


def _misfit(misfit: np.ndarray, sigma: np.ndarray) -> str:
    if np.isnan(misfit).any():
        return "-"
    return ", ".join(_pm(m, s, MM) for m, s in zip(misfit, sigma, strict=True))


def _solution(console: Console, solution: Solution) -> None:
    fit = solution.adjustment
    _heading(console, "All data at once: CoM of each link in its URDF frame")
    rows = [
        (link.link, _link_mass(solution, link), *(_component(link, i) for i in range(3)))
        for link in solution.links
        if link.source != (None, None, None) or link.mass > 0
    ]
    mass = "mass kg" if fit.unknowns.free_masses else "mass kg (URDF)"
    print_table(console, rows, ("link", mass, "x mm", "y mm", "z mm"))
    _bodies(console, solution)
    quality = (
        f"rank {fit.rank} of {fit.unknowns.size} unknowns, condition {fit.condition:.0f}, "
        f"chi2 {fit.chi2:.1f} for {fit.dof} degrees of freedom"
    )
    print_lines(console, [quality])
    if solution.misfit_p < MISFIT:
        misfit = (
            f"the model does not explain the data within their noise (p = {solution.misfit_p:.0e}, "
            f"limit {MISFIT:g}): sigmas are too small; look for what the model lacks"
        )
        print_lines(console, [misfit], style="bold")
    sums = [c for c in solution.combinations if len(c.coefficients) > 1]
    if sums:
        _heading(console, "Only sums are determined (first moments, kg mm)")
        print_table(console, [(c.words, _pm(c.value, c.sigma, 1e3)) for c in sums])
    if solution.unseen:
        _heading(console, "Not determined by these poses")
        print_table(console, _by_remedy(solution), ("first moments", "apart from one another"))
    held = solution.held_out
    how = "named, none of them fitted" if held.chosen else "cross-validated"
    _heading(console, f"Held-out poses ({how})")
    lines: list[str] = []
    if not np.isnan(held.com_rms):
        lines += [
            f"total CoM off the measured line by {held.com_rms * MM:.2f} mm rms (95 % upper end "
            f"{held.com_upper * MM:.2f} mm), {held.poses} poses",
            f"force {held.force_rms:.2f} N rms, moment {held.moment_rms:.3f} N m rms",
        ]
    elif np.isnan(held.torque_rms):
        lines.append("a single pose leaves nothing to hold out")
    if not np.isnan(held.torque_rms):
        lines.append(f"joint torque {held.torque_rms:.3f} N m rms, given the measured foot wrench")
    if held.rank_lost:
        lines.append(
            f"{held.rank_lost} time(s) the poses left out were the only ones of their kind: they "
            "were predicted with values of the URDF"
        )
    print_lines(console, lines)
    print_other_cuts(console, solution)


def _by_remedy(solution: Solution) -> list[tuple[str, str]]:
    """Join the directions that one pose would show."""
    order = solution.adjustment.unknowns.names
    grouped: dict[str, set[str]] = {}
    for unseen in solution.unseen:
        grouped.setdefault(unseen.remedy, set()).update(unseen.parts)
    return [
        (", ".join(name for name in order if name in parts), remedy)
        for remedy, parts in grouped.items()
    ]


def _link_mass(solution: Solution, link: LinkCom) -> str:
    if not solution.adjustment.unknowns.free_masses:
        return f"{link.mass:.3f}"
    if link.mass_source == "measured":
        return _pm(link.mass, link.mass_sigma)
    return "in a sum" if link.mass_source == "combination" else f"({link.mass:.3f} URDF)"


def _bodies(console: Console, solution: Solution) -> None:
    """Say which links are taken as one with another."""
    for link in solution.links:
        if link.members:
            line = f"{link.link} stands also for what is fixed to it: {', '.join(link.members)}"
            print_lines(console, [line])


def _component(link: LinkCom, i: int) -> str:
    source = link.source[i]
    if source == "measured":
        return _pm(link.com[i], float(np.sqrt(link.cov[i, i])), MM)
    if source == "prior":
        return f"({link.com[i] * MM:.1f} URDF)"
    return "in a sum" if source == "combination" else "unseen"


def _difference(console: Console, calibration: Calibration) -> None:
    difference, paper = calibration.difference, calibration.paper
    if difference is None or paper is None:
        return
    _heading(console, "Both routes side by side (mm); their difference by its own sigma")
    rows = [
        (name, _pm(a, sa, MM), _pm(b, s, MM), _pm(a - b, ds, MM))
        for name, a, sa, b, s, ds in zip(
            difference.names,
            difference.cramer,
            sigmas(paper.choices[0].cov),
            difference.lstsq,
            difference.lstsq_sigma,
            difference.sigma,
            strict=True,
        )
    ]
    print_table(console, rows, ("segment", "Cramer", "all data", "difference"))
    word = "agree" if difference.agree else "CONTRADICT one another"
    line = (
        f"the two routes {word} (p = {difference.p:.3f}); Cramer takes the feet's CoM from CAD, "
        "all data measures it"
    )
    print_lines(console, [line])


def _mass(console: Console, calibration: Calibration) -> None:
    solution = calibration.solution
    if solution is None:
        return
    urdf = calibration.robot.tree.total_mass
    _heading(console, "Mass of the whole robot")
    if np.isnan(solution.mass):
        line = (
            "not determined: no pose weighs the whole robot; its total CoM is not determined either"
        )
        print_lines(console, [line], style="bold")
        return
    line = (
        f"{_pm(solution.mass, solution.mass_sigma)} kg measured, {urdf:.3f} kg in "
        f"{calibration.reference} ({solution.mass - urdf:+.3f} kg)"
    )
    lines = [line]
    if urdf > 0.0 and abs(solution.mass - urdf) > EXCESS * solution.mass_sigma:
        gain = solution.mass / urdf - 1.0
        lines.append(
            f"a gain {100 * gain:+.1f} % off, common to the sensors that carry the robot, would "
            "weigh the same: only a scale tells it from a mass"
        )
    print_lines(console, lines)
