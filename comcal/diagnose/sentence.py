# SPDX-License-Identifier: Apache-2.0
"""The first sentence: what is wrong, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

from comcal.diagnose.diagnosis import Cause, Channel, Finding, Place, Rival, Verdict
from comcal.robot.changes import spec_of

CERTAIN = 15.0
"""Sigmas from which a cause is said to be there; a smaller effect that the catalogue lacks may look
like a named one."""

WEIGHED = 4
"""Causes of a set that are told in a sentence, if there are more than one beyond."""


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
    refused = _listed([finding.text for finding in findings])
    also = f" Besides, {refused}." if findings else ""
    if verdict is Verdict.UNEXPLAINED:
        at = f", most likely at {spot(place)}" if place is not None else where
        if not is_all:
            return f"None of the causes looked for explains the readings{at}.{also}"
        return f"Something acts that the catalogue has no name for{at}.{also}"
    if not causes:
        rest = "the rest fits the model" if is_all else "in the rest, nothing else was looked for"
        return f"Some readings cannot be used: {refused}; {rest}."
    names = _listed(_words(causes))
    if verdict is Verdict.AMBIGUOUS:
        return f"The readings do not tell which: {choices(groups)}.{also}"
    is_certain = all(cause.size >= CERTAIN for cause in causes)
    how = "explained by" if is_certain else "consistent with"
    return f"The readings are {how} {names}.{also}"


def choices(groups: Sequence[Sequence[Rival]]) -> str:
    """Return sets of causes in words; of a large one what a person can weigh at once."""
    return "; ".join(
        " or ".join(
            [
                *(rival.name for rival in _weighed(group)),
                *([f"one of {len(group) - WEIGHED} more"] if _weighed(group) != group else []),
            ]
        )
        for group in groups
    )


def _weighed(group: Sequence[Rival]) -> Sequence[Rival]:
    return group if len(group) <= WEIGHED + 1 else group[:WEIGHED]


def spot(place: Place) -> str:
    """Return a place in words, such as ``the encoder of l_knee``."""
    if not place.target:
        return f"the {place.place}"
    return f"the {place.place} of {place.target}"


def _words(causes: Sequence[Cause]) -> list[str]:
    """Return causes in words, what one link touched in several poses as one."""
    found: dict[str, list[int]] = {}
    for cause in causes:
        summary = spec_of(cause.change.effect).summary
        found.setdefault(f"{cause.name} ({summary})", []).extend(cause.change.poses() or ())
    return [f"{words}{_in(sorted(poses))}" for words, poses in found.items()]


def _in(poses: Sequence[int]) -> str:
    if not poses:
        return ""
    return f" in pose{'s' if len(poses) > 1 else ''} {_listed([str(pose) for pose in poses])}"


def _listed(words: Sequence[str]) -> str:
    return " and ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} and {words[-1]}"
