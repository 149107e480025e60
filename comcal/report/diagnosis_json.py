# SPDX-License-Identifier: Apache-2.0
"""``diagnosis.json``: format ``comcal-diagnosis/1``, the contract with other programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from comcal.diagnose.diagnosis import (
    Cause,
    Channel,
    Diagnosis,
    Estimate,
    Finding,
    HeldOut,
    Misfit,
    Place,
    Rival,
    Rung,
    Trace,
)
from comcal.report.json_numbers import number, numbers
from comcal.robot.changes import Change, Value

FORMAT = "comcal-diagnosis/1"


def diagnosis_json(
    diagnosis: Diagnosis, made_from: Mapping[str, str], robot: str = ""
) -> dict[str, Any]:
    """Return a diagnosis as JSON-able data; SI, NaN and infinity as null.

    Parameters
    ----------
    diagnosis : Diagnosis
    made_from : mapping
        sha256 of the files it was made from, by name.
    robot : str
        Name of the robot.
    """
    return {
        "format": FORMAT,
        "robot": robot,
        "verdict": diagnosis.verdict.value,
        "sentence": diagnosis.sentence,
        "misfit": _misfit(diagnosis.misfit),
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "ambiguous_groups": [[_rival(r) for r in group] for group in diagnosis.groups],
        "place": None if diagnosis.place is None else _place(diagnosis.place),
        "would_decide": list(diagnosis.would_decide),
        "residuals_by_channel": {c.name: _channel(c) for c in diagnosis.channels},
        "held_out": [_held_out(quantity) for quantity in diagnosis.held_out],
        "findings": [_finding(finding) for finding in diagnosis.findings],
        "scales": {family: float(scale) for family, scale in diagnosis.scales.items()},
        "blind": list(diagnosis.blind),
        "notes": list(diagnosis.notes),
        "ladder": [_rung(rung) for rung in diagnosis.ladder],
        "signatures": {
            name: {kind: number(share) for kind, share in shares.items()}
            for name, shares in diagnosis.signatures.items()
        },
        "traces": [_trace(trace) for trace in diagnosis.traces],
        "poses": diagnosis.poses,
        "used_rows": diagnosis.used_rows,
        "sha256": dict(made_from),
    }


def _misfit(misfit: Misfit) -> dict[str, Any]:
    before, after = misfit.held_out_before, misfit.held_out_after
    return {
        "chi2": number(misfit.chi2),
        "dof": int(misfit.dof),
        "p": number(misfit.p),
        "held_out_before": None if before is None else number(before),
        "held_out_after": None if after is None else number(after),
        "chi2_before": number(misfit.chi2_before),
        "p_before": number(misfit.p_before),
        "p_row": number(misfit.p_row),
        "row": misfit.row,
    }


def _cause(cause: Cause) -> dict[str, Any]:
    gain = cause.gain
    return {
        "effect": cause.change.effect,
        "target": cause.change.target,
        "parameters": _parameters(cause.change, cause.estimates),
        "gain": None
        if gain is None
        else {
            "held_out_fraction": number(gain.fraction),
            "interval": [number(bound) for bound in gain.interval],
        },
        "rivals": [_rival(rival) for rival in cause.rivals],
        "log_odds": number(cause.log_odds),
        "size": number(cause.size),
        "outside_tolerance": list(cause.outside),
        "signature": cause.signature,
        "remedy": cause.remedy,
        "separated_by": cause.separated_by,
    }


def _parameters(change: Change, estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in change.parameters.items():
        estimate = estimates.get(key)
        found[key] = {
            "value": _value(value),
            "sigma": None if estimate is None else number(estimate.sigma),
            "unit": "" if estimate is None else estimate.unit,
            "interval": None
            if estimate is None
            else [number(bound) for bound in estimate.interval],
        }
    return found


def _value(value: Value) -> float | list[int] | list[str] | None:
    if not isinstance(value, tuple):
        return number(value)
    ids = [item for item in value if not isinstance(item, str)]
    return ids or [str(item) for item in value]


def _rival(rival: Rival) -> dict[str, Any]:
    return {
        "effect": rival.effect,
        "target": rival.target,
        "log_odds": number(rival.log_odds),
        "left": number(rival.left),
        "poses": list(rival.poses),
    }


def _place(place: Place) -> dict[str, Any]:
    return {
        "place": place.place,
        "target": place.target,
        "function": place.function,
        "log_odds": number(place.log_odds),
    }


def _channel(channel: Channel) -> dict[str, Any]:
    return {
        "unit": channel.unit,
        "before": number(channel.before),
        "after": number(channel.after),
        "sigmas_before": number(channel.sigmas_before),
        "sigmas_after": number(channel.sigmas_after),
        "follows": channel.follows,
        "worst_pose": channel.worst if channel.worst >= 0 else None,
    }


def _held_out(quantity: HeldOut) -> dict[str, Any]:
    return {
        "name": quantity.name,
        "unit": quantity.unit,
        "before": number(quantity.before),
        "after": number(quantity.after),
        "gained": [number(bound) for bound in quantity.gained],
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "effect": finding.effect,
        "target": finding.target,
        "parameters": {key: _value(value) for key, value in finding.change.parameters.items()},
        "text": finding.text,
        "poses": list(finding.poses),
        "action": finding.action,
        "remedy": finding.remedy,
    }


def _rung(rung: Rung) -> dict[str, Any]:
    return {
        "named": list(rung.named),
        "best": [{"cause": name, "log_odds": number(gain)} for name, gain in rung.best],
        "threshold": number(rung.threshold),
        "chi2": number(rung.chi2),
    }


def _trace(trace: Trace) -> dict[str, Any]:
    return {
        "name": trace.name,
        "unit": trace.unit,
        "poses": list(trace.poses),
        "before": numbers(trace.before),
        "after": numbers(trace.after),
        "sigma": numbers(trace.sigma),
    }
