# SPDX-License-Identifier: Apache-2.0
"""The last line of a demo: what was hidden, against what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from comcal.diagnose.diagnosis import Cause, Diagnosis, Verdict
from comcal.report.display_units import shown_unit
from comcal.robot.changes import Change, spec_of


@dataclass(frozen=True)
class Judgement:
    """How what was found compares with what was hidden.

    Parameters
    ----------
    hidden : tuple of Change
    is_right : bool
        Everything hidden was named, and nothing else, without reserve.
    is_among : bool
        Everything hidden is in a set of causes that the readings do not tell apart.
    inside, values : int
        How many of the parameters found have the truth in their 95 % interval.
    """

    hidden: tuple[Change, ...]
    is_right: bool
    is_among: bool
    inside: int
    values: int


def judge(hidden: Sequence[Change], diagnosis: Diagnosis) -> Judgement:
    """Compare a diagnosis with the truth, by effect and target; sizes are counted besides.

    Parameters
    ----------
    hidden : sequence of Change
        Empty: nothing was.
    diagnosis : Diagnosis
    """
    sought = {(change.effect, change.target) for change in hidden}
    causes = {(cause.change.effect, cause.change.target): cause for cause in diagnosis.causes}
    found = {*causes, *((finding.effect, finding.target) for finding in diagnosis.findings)}
    wanted = Verdict.EXPLAINED if hidden else Verdict.NOTHING_WRONG
    offered = {(rival.effect, rival.target) for group in diagnosis.groups for rival in group}
    is_inside = [
        inside
        for change in hidden
        for inside in _inside(change, causes.get((change.effect, change.target)))
    ]
    return Judgement(
        hidden=tuple(hidden),
        is_right=diagnosis.verdict is wanted and found == sought,
        is_among=diagnosis.verdict is Verdict.AMBIGUOUS and sought <= found | offered,
        inside=sum(is_inside),
        values=len(is_inside),
    )


def hidden_line(judgement: Judgement) -> str:
    """Return what was hidden, and whether it was found.

    Parameters
    ----------
    judgement : Judgement
    """
    hidden = " and ".join(map(change_words, judgement.hidden)) or "nothing"
    if judgement.is_among:
        return f"hidden was: {hidden}; NOT DECIDED: it is one of those not told apart"
    if not judgement.is_right:
        return f"hidden was: {hidden}; WRONG: that is not what was found"
    if not judgement.values:
        return f"hidden was: {hidden}; RIGHT"
    count = f"{judgement.inside} of {judgement.values}"
    return f"hidden was: {hidden}; RIGHT, {count} values in their 95 % interval"


def change_words(change: Change) -> str:
    """Return a change in the units that people read: ``payload@torso: mass 3.1 kg, com_x 80 mm``.

    Parameters
    ----------
    change : Change
    """
    keys = spec_of(change.effect).keys
    parts: list[str] = []
    for key, value in change.parameters.items():
        if isinstance(value, tuple):
            parts.append(f"{key} {', '.join(map(str, value))}")
            continue
        factor, unit = shown_unit(keys[key].unit, key)
        parts.append(f"{key} {value * factor:.4g} {unit}".rstrip())
    return f"{change.name}: {', '.join(parts)}"


def _inside(truth: Change, cause: Cause | None) -> list[bool]:
    """Return of every parameter found whether its interval holds the truth; 0 where not given."""
    if cause is None:
        return []
    return [
        bool(estimate.interval[0] <= truth.number(key) <= estimate.interval[1])
        for key, estimate in cause.estimates.items()
    ]
