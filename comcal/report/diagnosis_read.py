# SPDX-License-Identifier: Apache-2.0
"""``diagnosis.json`` back to what it was made of."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from comcal.diagnose.diagnosis import (
    Cause,
    Channel,
    Diagnosis,
    Estimate,
    Finding,
    Gain,
    HeldOut,
    Misfit,
    Place,
    Rival,
    Rung,
    Trace,
    Verdict,
)
from comcal.errors import ConfigError
from comcal.report.diagnosis_json import FORMAT
from comcal.robot.changes import Change, Value
from comcal.robot.tree import Array


def diagnosis_from_json(content: Mapping[str, Any], where: str = "") -> Diagnosis:
    """Return the diagnosis that :func:`~comcal.report.diagnosis_json.diagnosis_json` wrote.

    Parameters
    ----------
    content : mapping
    where : str
        Its file, for the message.

    Raises
    ------
    ConfigError
        If it is of another format, or damaged.
    """
    if content.get("format") != FORMAT:
        raise ConfigError(
            "is not a diagnosis",
            where=where,
            measured=f"format {content.get('format')!r}",
            limit=FORMAT,
            next_step="diagnose the session again",
        )
    try:
        return _diagnosis(content)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            "is damaged, or of another version",
            where=where,
            next_step="diagnose the session again",
        ) from error


def _diagnosis(content: Mapping[str, Any]) -> Diagnosis:
    return Diagnosis(
        verdict=Verdict(content["verdict"]),
        sentence=content["sentence"],
        causes=tuple(map(_cause, content["causes"])),
        groups=tuple(tuple(map(_rival, group)) for group in content["ambiguous_groups"]),
        findings=tuple(map(_finding, content["findings"])),
        place=None if content["place"] is None else _place(content["place"]),
        misfit=_misfit(content["misfit"]),
        would_decide=tuple(content["would_decide"]),
        channels=tuple(_channel(n, c) for n, c in content["residuals_by_channel"].items()),
        traces=tuple(map(_trace, content["traces"])),
        ladder=tuple(map(_rung, content["ladder"])),
        scales=content["scales"],
        blind=tuple(content["blind"]),
        notes=tuple(content["notes"]),
        poses=content["poses"],
        used_rows=content["used_rows"],
        held_out=tuple(map(_held_out, content["held_out"])),
        signatures={
            name: {kind: _number(share) for kind, share in shares.items()}
            for name, shares in content["signatures"].items()
        },
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _odds(value: float | None) -> float:
    """Return log odds; what is not finite in JSON is the certainty of a mistake undone."""
    return math.inf if value is None else float(value)


def _value(value: Any) -> Value:
    return tuple(value) if isinstance(value, list) else _number(value)


def _misfit(content: Mapping[str, Any]) -> Misfit:
    numbers = {
        key: _number(content[key]) for key in ("chi2", "p", "chi2_before", "p_before", "p_row")
    }
    held_out = {key: content[key] for key in ("held_out_before", "held_out_after")}
    return Misfit(dof=content["dof"], row=content["row"], **numbers, **held_out)


def _pair(bounds: list[float | None]) -> tuple[float, float]:
    """Return an interval; a bound that is not finite in JSON is none."""
    low, high = bounds
    return -math.inf if low is None else low, math.inf if high is None else high


def _cause(content: Mapping[str, Any]) -> Cause:
    parameters = content["parameters"]
    gain = content["gain"]
    return Cause(
        change=Change(
            content["effect"],
            content["target"],
            {key: _value(entry["value"]) for key, entry in parameters.items()},
        ),
        estimates={
            key: Estimate(
                _number(entry["value"]),
                _number(entry["sigma"]),
                _pair(entry["interval"]),
                entry["unit"],
            )
            for key, entry in parameters.items()
            if entry["interval"] is not None
        },
        log_odds=_odds(content["log_odds"]),
        size=_number(content["size"]),
        rivals=tuple(map(_rival, content["rivals"])),
        gain=None
        if gain is None
        else Gain(_number(gain["held_out_fraction"]), _pair(gain["interval"])),
        signature=content["signature"],
        remedy=content["remedy"],
        separated_by=content["separated_by"],
        outside=tuple(content["outside_tolerance"]),
    )


def _rival(content: Mapping[str, Any]) -> Rival:
    return Rival(
        content["effect"],
        content["target"],
        _odds(content["log_odds"]),
        _number(content["left"]),
        poses=tuple(content.get("poses", ())),
    )


def _place(content: Mapping[str, Any]) -> Place:
    return Place(
        content["place"], content["target"], content["function"], _odds(content["log_odds"])
    )


def _held_out(content: Mapping[str, Any]) -> HeldOut:
    low, high = content["gained"]
    return HeldOut(
        name=content["name"],
        unit=content["unit"],
        before=_number(content["before"]),
        after=_number(content["after"]),
        gained=(_number(low), _number(high)),
    )


def _finding(content: Mapping[str, Any]) -> Finding:
    parameters = {key: _value(value) for key, value in content["parameters"].items()}
    return Finding(
        effect=content["effect"],
        target=content["target"],
        change=Change(content["effect"], content["target"], parameters),
        text=content["text"],
        poses=tuple(content["poses"]),
        action=content["action"],
        remedy=content["remedy"],
    )


def _channel(name: str, content: Mapping[str, Any]) -> Channel:
    worst = content["worst_pose"]
    return Channel(
        name=name,
        unit=content["unit"],
        before=_number(content["before"]),
        after=_number(content["after"]),
        sigmas_before=_number(content["sigmas_before"]),
        sigmas_after=_number(content["sigmas_after"]),
        follows=content["follows"],
        worst=-1 if worst is None else worst,
    )


def _rung(content: Mapping[str, Any]) -> Rung:
    return Rung(
        named=tuple(content["named"]),
        best=tuple((entry["cause"], _odds(entry["log_odds"])) for entry in content["best"]),
        threshold=_number(content["threshold"]),
        chi2=_number(content["chi2"]),
    )


def _trace(content: Mapping[str, Any]) -> Trace:
    before, after, sigma = (_array(content[key]) for key in ("before", "after", "sigma"))
    return Trace(content["name"], content["unit"], tuple(content["poses"]), before, after, sigma)


def _array(values: list[float | None]) -> Array:
    return np.array([_number(value) for value in values], np.float64)
