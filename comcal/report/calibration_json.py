# SPDX-License-Identifier: Apache-2.0
"""``result.json``: format ``comcal-result/1``, the contract with other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from comcal.identify.calibration import Calibration
from comcal.identify.difference import RouteDifference
from comcal.identify.paper_route import ConfigurationCom, PaperRoute
from comcal.identify.solution import LinkCom, Solution, sigmas
from comcal.report.assumptions_json import consistent_json, prior_json
from comcal.report.json_numbers import number as _number
from comcal.report.json_numbers import numbers as _numbers
from comcal.report.other_cuts import other_cuts_json

FORMAT = "comcal-result/1"


def calibration_json(calibration: Calibration, made_from: Mapping[str, str]) -> dict[str, Any]:
    """Return a calibration as JSON-able data; SI, NaN as null.

    Parameters
    ----------
    calibration : Calibration
    made_from : mapping
        sha256 of the files it was made from, by name.
    """
    solution = calibration.solution
    result: dict[str, Any] = {
        "format": FORMAT,
        "robot": calibration.robot.name,
        "fitted": list(calibration.table.pose),
        "verdict": calibration.verdict.value,
        "reason": calibration.reason,
        "checks": [
            {"name": c.name, "measured": _number(c.measured), "limit": c.limit, "unit": c.unit}
            for c in calibration.checks
        ],
        "mass": None,
        "carried_mass": None,
        "coefficients": _coefficients(calibration),
        "total_com": _totals(calibration),
        "links": [_link(link) for link in solution.links] if solution else [],
        "combinations": _combinations(solution),
        "rank": solution.adjustment.rank if solution else None,
        "unknowns": solution.adjustment.unknowns.size if solution else None,
        "condition": _number(solution.adjustment.condition) if solution else None,
        "chi2": solution.adjustment.chi2 if solution else None,
        "dof": solution.adjustment.dof if solution else None,
        "held_out": _held_out(solution),
        "unseen": [{"what": u.words, "remedy": u.remedy} for u in solution.unseen]
        if solution
        else [],
        "cramer": _cramer(calibration.paper),
        "difference": _difference(calibration.difference),
        "without_torques": _without_torques(calibration.without_torques),
        "scope": asdict(solution.scope) if solution else None,
        "with_prior": prior_json(calibration.with_prior) if calibration.with_prior else None,
        "consistent": consistent_json(calibration.consistent) if calibration.consistent else None,
        "notes": [*calibration.table.notes, *calibration.notes],
        "sha256": dict(made_from),
    }
    if solution:
        urdf = calibration.robot.tree.total_mass
        result["mass"] = {
            "value": _number(solution.mass),
            "sigma": _number(solution.mass_sigma),
            "urdf": urdf,
        }
    if calibration.coefficients is not None:
        mass, sigma = calibration.coefficients.mass, calibration.coefficients.mass_sigma
        weight = 1.0 / sigma**2
        result["carried_mass"] = {
            "value": float(np.sum(weight * mass) / weight.sum()),
            "sigma": float(weight.sum() ** -0.5),
        }
    return result


def _coefficients(calibration: Calibration) -> list[dict[str, Any]]:
    coefficients = calibration.coefficients
    if coefficients is None:
        return []
    names = ("alpha", "beta", "gamma", "delta")
    return [
        {
            "pose": calibration.table.pose[row],
            **dict(zip(names, map(float, value), strict=True)),
            "sigma": dict(zip(names, map(float, sigma), strict=True)),
        }
        for row, value, sigma in zip(
            coefficients.rows, coefficients.values, coefficients.sigma, strict=True
        )
    ]


def _totals(calibration: Calibration) -> list[dict[str, Any]]:
    table = calibration.table
    totals = [_configuration(calibration, t) for t in _paper_totals(calibration.paper)]
    if calibration.solution:
        totals += [
            {
                "configuration": table.configuration[p.row] or None,
                "pose": p.pose,
                "frame": "P",
                "xyz": _numbers(p.xyz),
                "carried_xyz": _numbers(p.carried_xyz),
                "cov": _numbers(p.cov + p.cov_cad),
                "sigma_cad": _numbers(sigmas(p.cov_cad)),
                "by": "lstsq",
                "assumes": ["link masses of the URDF", "links below the cuts as in the URDF"],
            }
            for p in calibration.solution.poses
        ]
    return totals


def _paper_totals(paper: PaperRoute | None) -> tuple[ConfigurationCom, ...]:
    return paper.totals if paper else ()


def _configuration(calibration: Calibration, total: ConfigurationCom) -> dict[str, Any]:
    assumes = {
        "twin": ["m_u, r_u, l_u and U of the URDF", "rigid tilt about the ankles"],
        "slope": ["one shape on both slopes"],
        "given": ["the CoM as given"],
    }
    return {
        "configuration": total.configuration.name,
        "pose": calibration.table.pose[total.configuration.rows[0]],
        "frame": "P",
        "xyz": _numbers(total.xyz),
        "carried_xyz": _numbers(total.carried_xyz),
        "cov": _numbers(total.cov + total.cov_cad),
        "sigma_cad": _numbers(sigmas(total.cov_cad)),
        "by": total.by,
        "assumes": assumes[total.by],
    }


def _link(link: LinkCom) -> dict[str, Any]:
    return {
        "link": link.link,
        "mass": link.mass,
        "com": _numbers(link.com),
        "cov": _numbers(link.cov),
        "identifiable": [bool(i) for i in link.identifiable],
        "source": list(link.source),
        "mass_sigma": _number(link.mass_sigma),
        "mass_source": link.mass_source,
        "members": list(link.members),
    }


def _combinations(solution: Solution | None) -> list[dict[str, Any]]:
    if solution is None:
        return []
    return [
        {
            "words": c.words,
            "coefficients": c.coefficients,
            "value": c.value,
            "sigma": c.sigma,
            "unit": _unit(c.coefficients),
        }
        for c in solution.combinations
    ]


def _unit(coefficients: Mapping[str, float]) -> str:
    """Return the unit of a combination: that of its masses if it has no other parts."""
    if all(name.endswith("mass") for name in coefficients):
        return "kg"
    if all(" offset " in name for name in coefficients):
        return "N" if all(name[-2] == "f" for name in coefficients) else "N m"
    return "kg m"


def _without_torques(solution: Solution | None) -> dict[str, Any] | None:
    if solution is None:
        return None
    fit = solution.adjustment
    return {
        "rank": fit.rank,
        "condition": _number(fit.condition),
        "chi2": fit.chi2,
        "dof": fit.dof,
        "held_out": _held_out(solution),
    }


def _held_out(solution: Solution | None) -> dict[str, Any] | None:
    if solution is None:
        return None
    h = solution.held_out
    return {
        "com_rms_mm": _number(h.com_rms * 1e3),
        "com_upper_mm": _number(h.com_upper * 1e3),
        "force_rms": _number(h.force_rms),
        "moment_rms": _number(h.moment_rms),
        "torque_rms": _number(h.torque_rms),
        "poses": h.poses,
        "named": h.chosen,
        "cuts": other_cuts_json(solution),
    }


def _cramer(paper: PaperRoute | None) -> dict[str, Any] | None:
    if paper is None:
        return None
    if paper.chain is None:
        return {"reason": paper.reason, "refused": [str(e) for e in paper.refused]}
    chain = paper.chain
    names = [t.configuration.name for t in paper.totals]
    return {
        "reason": paper.reason,
        "refused": [str(e) for e in paper.refused],
        "segments": [
            {
                "links": [chain.robot.tree.links[k].name for k in s.links],
                "mass": s.mass,
                "anchor": chain.robot.tree.joints[s.anchor - 1].name if s.anchor else None,
            }
            for s in chain.segments
        ],
        "choices": [
            {
                "solving": [names[i] for i in c.choice.solving],
                "checking": [names[i] for i in c.choice.checking],
                "determinant": c.choice.determinant,
                "r": _numbers(c.w.imag),
                "l": _numbers(c.w.real),
                "cov": _numbers(c.cov),
                "noise_gain": _numbers(c.noise_gain),
                "misfit": _numbers(c.misfit),
                "misfit_sigma": _numbers(c.misfit_sigma),
            }
            for c in paper.choices
        ],
    }


def _difference(difference: RouteDifference | None) -> dict[str, Any] | None:
    if difference is None:
        return None
    return {
        "names": list(difference.names),
        "cramer": _numbers(difference.cramer),
        "lstsq": _numbers(difference.lstsq),
        "sigma": _numbers(difference.sigma),
        "p": difference.p,
        "agree": difference.agree,
    }
