# SPDX-License-Identifier: Apache-2.0
"""The first sentence: what is wrong, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

from comcal.diagnose.diagnosis import Cause, Channel, Finding, Place, Rival, Verdict
from comcal.robot.changes import spec_of

CERTAIN = 15.0
"""Sigmas from which a cause is said to be there; a smaller effect that the catalogue lacks may look
like a named one."""


def sentence(
    verdict: Verdict,
    causes: Sequence[Cause],
    groups: Sequence[Sequence[Rival]],
    findings: Sequence[Finding],
    place: Place | None,
    channels: Sequence[Channel],
    *,
    is_all: bool = True,
) -> str:
    """Say in one sentence what the model gets wrong; *is_all*: the whole catalogue was searched."""
    worst = channels[0] if channels else None
    where = "" if worst is None else f"; furthest off is {worst.name}"
    if verdict is Verdict.NOTHING_WRONG:
        return "The model explains the readings within noise and healthy tolerances."
    if verdict is Verdict.UNEXPLAINED:
        at = f", most likely at {spot(place)}" if place is not None else where
        if not is_all:
            return f"None of the causes looked for explains the readings{at}."
        return f"Something acts that the catalogue has no name for{at}."
    refused = _listed([finding.text for finding in findings])
    if not causes:
        return f"Some readings cannot be used: {refused}; the rest fits the model."
    names = _listed([_words(cause) for cause in causes])
    also = f" Besides, {refused}." if findings else ""
    if verdict is Verdict.AMBIGUOUS:
        sets = "; ".join(" or ".join(rival.name for rival in group) for group in groups)
        return f"The readings do not tell which: {sets}.{also}"
    is_certain = all(cause.size >= CERTAIN for cause in causes)
    how = "explained by" if is_certain else "consistent with"
    return f"The readings are {how} {names}.{also}"


def spot(place: Place) -> str:
    """Return a place in words, such as ``the encoder of l_knee``."""
    if not place.target:
        return f"the {place.place}"
    return f"the {place.place} of {place.target}"


def _words(cause: Cause) -> str:
    return f"{cause.name} ({spec_of(cause.change.effect).summary})"


def _listed(words: Sequence[str]) -> str:
    return " and ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} and {words[-1]}"
