# SPDX-License-Identifier: Apache-2.0
"""Changes as they are typed: ``--effect NAME@TARGET:key=value,key=value``.

Numbers may carry a unit (``mass=5 kg``, ``roll=0.5 deg``); lists are joined by plus signs
(``poses=3+5``, ``channels=fx+fy``).
"""

from __future__ import annotations

import re

from comcal.errors import ConfigError, UsageError
from comcal.robot.changes import Change, Value, check_change, spec_of
from comcal.robot.changes_kinds import Key, KeyKind
from comcal.robot.units import Dimension, parse_quantity
from comcal.robot.validate import did_you_mean

_FORM = "NAME@TARGET:key=value,key=value"
_INTEGER = re.compile(r"[+-]?\d+", re.ASCII)


def parse_change(text: str) -> Change:
    """Return the change that *text* describes; robots are not asked.

    Raises
    ------
    UsageError
        If it is not of that form, or name, key or value are not those of an effect; what was
        probably meant is named.

    Examples
    --------
    >>> parse_change("payload@torso:mass=5,com_z=20 cm").number("com_z")
    0.2
    """
    where = f"--effect {text}"
    head, colon, tail = text.partition(":")
    name, at, target = (part.strip() for part in head.partition("@"))
    if not name or (at and not target):
        raise UsageError("an effect must have a name", where=where, next_step=f"type {_FORM}")
    spec = spec_of(name, where)
    if not colon or not tail.strip():
        raise UsageError(
            f"{name} has no parameters here",
            where=where,
            next_step=f"type {_FORM} with {', '.join(k.label() for k in spec.keys.values())}"[:300],
        )
    parameters = dict[str, Value]()
    for part in tail.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or not value:
            raise UsageError(
                f"{part.strip()!r} is not key=value", where=where, next_step=f"type {_FORM}"
            )
        if key not in spec.keys:
            raise UsageError(
                f"{name} has no parameter {key!r}",
                where=where,
                next_step=did_you_mean(key, list(spec.keys)),
            )
        if key in parameters:
            raise UsageError(f"{key} is given twice", where=where, next_step="give it once")
        parameters[key] = _value(spec.keys[key], value, where)
    change = Change(name, target, parameters)
    check_change(change, where)
    return change


def change_text(change: Change) -> str:
    """Return the text that :func:`parse_change` reads back to the last bit."""
    parts = [f"{key}={_text(value)}" for key, value in change.parameters.items()]
    return f"{change.name}:{','.join(parts)}"


def _value(key: Key, text: str, where: str) -> Value:
    if key.kind is KeyKind.NUMBER:
        try:
            # Without a dimension of its own only a plain number can be meant.
            return parse_quantity(text, key.dimension or Dimension.RATIO)
        except ConfigError as problem:
            raise UsageError(
                f"{key.name}: {problem.what}",
                where=where,
                measured=problem.measured,
                limit=problem.limit,
                next_step=problem.next_step or f"its unit is {key.unit}",
            ) from problem
    items = tuple(item.strip() for item in text.split("+"))
    if key.kind is KeyKind.WORDS:
        return items
    if not all(_INTEGER.fullmatch(item) for item in items):
        raise UsageError(
            f"{key.name} must be pose ids joined by +",
            where=where,
            measured=f"got {text!r}",
            next_step=f"type {key.name}=3+5",
        )
    return tuple(int(item) for item in items)


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return "+".join(str(item) for item in value)
    return repr(float(value))
