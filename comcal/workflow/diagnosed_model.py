# SPDX-License-Identifier: Apache-2.0
"""The model to go on with after a diagnosis: what was assumed, and the causes that were named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from comcal.diagnose.diagnosis import Cause, Diagnosis, Verdict
from comcal.effects.registry import stage_of
from comcal.robot.changes import Change, Value
from comcal.robot.changes_yaml import KnownChange, extension_text

ADDITIVE = frozenset(
    {
        "ft_bias",
        "ft_drift",
        "ft_temperature",
        "link_mass",
        "link_com",
        "link_length",
        "sole_mass",
        "joint_offset",
        "current_offset",
        "cable_pull",
        "internal_torque_term",
        "inertia",
    }
)
"""Effects of which two at one target, one after the other, are one with the sum of both."""


def extended_model(given: Sequence[KnownChange], diagnosis: Diagnosis) -> tuple[KnownChange, ...]:
    """Return the changes of the nominal model that a diagnosis ends with.

    Parameters
    ----------
    given : sequence of KnownChange
        The model that was diagnosed.
    diagnosis : Diagnosis

    Returns
    -------
    tuple of KnownChange
        In the order in which they apply. A cause that corrects an effect of the given model is
        added to it: its sigma is then that of the cause, which was measured against it.
    """
    model = list(given)
    for cause in sorted(diagnosis.causes, key=lambda cause: stage_of(cause.change)):
        known = _known(cause)
        at = _same_place(model, known.change)
        if at is None:
            model.append(known)
        else:
            model[at] = _sum(model[at], known)
    return tuple(model)


def extended_text(given: Sequence[KnownChange], diagnosis: Diagnosis) -> str:
    """Return the content of ``extended.yaml``, with a comment that says how far to trust it.

    Parameters
    ----------
    given : sequence of KnownChange
    diagnosis : Diagnosis
    """
    lines = ["true minus assumed, of the frozen robot.yaml and URDF of this session"]
    if diagnosis.verdict is Verdict.UNEXPLAINED:
        lines.append("PARTIAL: the verdict is unexplained; more is wrong than these causes say")
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        lines += [
            "AMBIGUOUS: the readings exclude none of " + " or ".join(rival.name for rival in group)
            for group in diagnosis.groups
        ]
    if not diagnosis.causes:
        lines.append("no cause was named: this is the model that was given")
    comment = "".join(f"# {line}\n" for line in lines)
    return comment + extension_text(extended_model(given, diagnosis))


def _known(cause: Cause) -> KnownChange:
    sigma = {key: estimate.sigma for key, estimate in cause.estimates.items()}
    return KnownChange(cause.change, sigma)


def _same_place(model: Sequence[KnownChange], change: Change) -> int | None:
    """Return the entry that a change can be added to: the last at its target, of its effect."""
    if change.effect not in ADDITIVE:
        return None
    for i in reversed(range(len(model))):
        entry = model[i].change
        if entry.target == change.target:
            return i if entry.effect == change.effect else None
    return None


def _sum(old: KnownChange, new: KnownChange) -> KnownChange:
    keys = dict.fromkeys((*old.change.parameters, *new.change.parameters))
    total: dict[str, Value] = {k: old.change.number(k) + new.change.number(k) for k in keys}
    return KnownChange(replace(old.change, parameters=total), {**old.sigma, **new.sigma})
