# SPDX-License-Identifier: Apache-2.0
"""A change of a robot against its description: an effect, where it sits, and how large it is.

Data only. What a change does is written twice, on purpose: once in the simulators, which hide it,
and once in the effects of the diagnosis, which find it. This module is all that the two share.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from comcal.errors import UsageError
from comcal.robot.changes_kinds import EffectSpec, Key, KeyKind, TargetKind
from comcal.robot.changes_table import CHANNELS, IMU_CHANNELS, JOINT_CHANNELS
from comcal.robot.effect_specs import effect_specs
from comcal.robot.model import Robot
from comcal.robot.tree import JointType
from comcal.robot.validate import did_you_mean

ALL = "all"
"""Target that stands for every joint or every foot."""
IMU = "imu"
"""Target of effects on the one IMU."""

Value = float | tuple[int, ...] | tuple[str, ...]
"""A number in SI, pose ids, or words."""


@dataclass(frozen=True)
class Change:
    """One effect: what is true minus what the model assumes.

    Parameters
    ----------
    effect : str
        Name in :func:`~comcal.robot.effect_specs.effect_specs`.
    target : str
        Link, joint, sensor, foot, ``imu``, ``all``, or empty where the effect has no target.
    parameters : mapping from key to Value
        SI and radians; keys that are not given are zero.
    """

    effect: str
    target: str = ""
    parameters: Mapping[str, Value] = field(default_factory=dict[str, Value])

    @property
    def name(self) -> str:
        """``effect@target``, or the effect alone where it has no target."""
        return f"{self.effect}@{self.target}" if self.target else self.effect

    def number(self, key: str, default: float = 0.0) -> float:
        """Return a parameter that is a number, *default* where it is not given."""
        value = self.parameters.get(key, default)
        return default if isinstance(value, tuple) else float(value)

    def numbers(self, *keys: str) -> list[float]:
        """Return several parameters, zero where they are not given."""
        return [self.number(key) for key in keys]

    def poses(self) -> tuple[int, ...] | None:
        """Return the ids of the poses concerned; None: all of them."""
        value = self.parameters.get("poses")
        return cast("tuple[int, ...]", value) if isinstance(value, tuple) else None

    def words(self, key: str) -> tuple[str, ...]:
        """Return a parameter that is a list of words; empty where it is not given."""
        value = self.parameters.get(key, ())
        return cast("tuple[str, ...]", value) if isinstance(value, tuple) else ()


def spec_of(effect: str, where: str = "") -> EffectSpec:
    """Return what is known of an effect.

    Raises
    ------
    UsageError
        If there is none of that name.
    """
    known = effect_specs()
    if effect not in known:
        raise UsageError(
            f"there is no effect {effect!r}",
            where=where,
            next_step=did_you_mean(effect, list(known)) or f"there are {', '.join(known)}",
        )
    return known[effect]


def check_change(change: Change, where: str = "") -> None:
    """Check name, keys and values of a change; whether the target exists, the robot says.

    Parameters
    ----------
    change : Change
    where : str
        File and line, or the argument typed, for the message.

    Raises
    ------
    UsageError
        Naming the first thing that is wrong, and what was probably meant.
    """
    spec = spec_of(change.effect, where)
    if change.target and spec.targets == frozenset({TargetKind.NONE}):
        raise UsageError(
            f"{change.effect} has no target",
            where=where,
            measured=f"got {change.target!r}",
            next_step=f"leave out @{change.target}",
        )
    if not change.target and TargetKind.NONE not in spec.targets:
        raise UsageError(
            f"{change.effect} needs a target",
            where=where,
            next_step=f"name a {' or '.join(sorted(kind.value for kind in spec.targets))}: "
            f"{change.effect}@NAME",
        )
    if change.target == ALL and not spec.has_all:
        raise UsageError(
            f"{change.effect} cannot be given for all targets at once",
            where=where,
            next_step="repeat it for every target",
        )
    for name, value in change.parameters.items():
        if name not in spec.keys:
            raise UsageError(
                f"{change.effect} has no parameter {name!r}",
                where=where,
                next_step=did_you_mean(name, list(spec.keys)),
            )
        _check_value(spec.keys[name], value, where)
    missing = [k.name for k in spec.keys.values() if k.required and k.name not in change.parameters]
    if missing or not change.parameters:
        labels = [key.label() for key in spec.keys.values()]
        more = f" and {len(labels) - 9} more" if len(labels) > 9 else ""
        raise UsageError(
            f"{change.effect} lacks {' and '.join(missing) or 'parameters'}",
            where=where,
            next_step=f"its parameters: {', '.join(labels[:9])}{more}",
        )


def _check_value(key: Key, value: Value, where: str) -> None:
    if key.kind is KeyKind.NUMBER:
        if isinstance(value, tuple) or not math.isfinite(value):
            raise UsageError(
                f"{key.name} must be a finite number",
                where=where,
                measured=f"got {value!r}",
                next_step=f"write {key.label()}",
            )
        if not key.allows(value):
            raise UsageError(
                f"{key.name} is out of its range",
                where=where,
                measured=f"{value:g} {key.unit}",
                limit=key.range(),
                next_step="give a value in the range",
            )
        return
    are_ids = isinstance(value, tuple) and not any(isinstance(item, str) for item in value)
    if not isinstance(value, tuple) or not value or are_ids is not (key.kind is KeyKind.POSES):
        raise UsageError(
            f"{key.name} must be a list of {'pose ids' if key.kind is KeyKind.POSES else 'words'}",
            where=where,
            measured=f"got {value!r}",
            next_step="give one or more, as a list",
        )


def target_kind(change: Change, robot: Robot, where: str = "") -> TargetKind:
    """Return what the target of a change is in *robot*.

    Parameters
    ----------
    change : Change
    robot : Robot
    where : str
        For the message.

    Raises
    ------
    UsageError
        If the robot has no such target; near names are given.
    """
    spec = spec_of(change.effect, where)
    # A link and a sensor may share a name; what most effects sit at comes first.
    known = {kind: names_of(robot, kind) for kind in _ORDER if kind in spec.targets}
    if change.target == ALL and spec.has_all:
        kind = next(k for k in (TargetKind.JOINT, TargetKind.FOOT) if k in known)
        if known[kind]:
            return kind
    for kind, names in known.items():
        if change.target in names:
            return kind
    names = [name for names in known.values() for name in names if name]
    kinds = " or ".join(kind.value for kind in known if kind is not TargetKind.NONE)
    raise UsageError(
        f"robot {robot.name!r} has no {kinds} {change.target!r} for {change.effect}",
        where=where,
        next_step=did_you_mean(change.target, names + ([ALL] if spec.has_all else [])),
    )


_ORDER = (
    TargetKind.SENSOR,
    TargetKind.JOINT,
    TargetKind.FOOT,
    TargetKind.IMU,
    TargetKind.LINK,
    TargetKind.NONE,
)


def names_of(robot: Robot, kind: TargetKind) -> tuple[str, ...]:
    """Return the names of all possible targets of one kind."""
    if kind is TargetKind.LINK:
        return tuple(link.name for link in robot.tree.links)
    if kind is TargetKind.JOINT:
        return tuple(joint.name for joint in robot.tree.joints)
    if kind is TargetKind.SENSOR:
        return (*robot.sensors, *robot.plates)
    if kind is TargetKind.FOOT:
        return tuple(robot.feet)
    if kind is TargetKind.IMU:
        return (IMU,) if robot.imu_link is not None else ()
    return ("",)


def check_changes(changes: Sequence[Change], robot: Robot, where: str = "") -> None:
    """Check changes by themselves, then against a robot.

    Parameters
    ----------
    changes : sequence of Change
    robot : Robot
    where : str
        For the message.

    Raises
    ------
    UsageError
        If one is not valid, its target does not exist, or a joint does not move that would have to.
    """
    for change in changes:
        check_change(change, where)
        kind = target_kind(change, robot, where)
        if kind is TargetKind.JOINT and change.target != ALL and change.effect != "link_length":
            joint = robot.tree.joints[robot.tree.joint_index[change.target]]
            if joint.mimic is not None or joint.kind is JointType.FIXED:
                how = "is fixed" if joint.mimic is None else f"follows {joint.mimic.joint}"
                raise UsageError(
                    f"joint {joint.name} {how}: {change.effect} has no meaning there",
                    where=where,
                    next_step=did_you_mean(joint.name, robot.tree.joint_names),
                )
        _check_words(change, kind, names_of(robot, kind), where)


def channels_of(kind: TargetKind) -> tuple[str, ...]:
    """Return the names of the channels that readings of one kind of target have."""
    by_kind = {
        TargetKind.SENSOR: CHANNELS,
        TargetKind.IMU: IMU_CHANNELS,
        TargetKind.JOINT: JOINT_CHANNELS,
    }
    return by_kind.get(kind, ())


def _check_words(change: Change, kind: TargetKind, names: Sequence[str], where: str) -> None:
    """Check what the words of a change name: channels, an axis, another joint or sensor."""
    known = {
        "channels": ("channel", channels_of(kind)),
        "axis": ("axis", ("x", "y", "z")),
        "other": (f"other {kind.value}", tuple(names)),
    }
    for key, (what, possible) in known.items():
        for word in change.words(key):
            if word not in possible:
                raise UsageError(
                    f"{change.effect} at {change.target}: there is no {what} {word!r}",
                    where=where,
                    next_step=did_you_mean(word, possible),
                )
    if change.effect == "channel_swap":
        of_two = kind is TargetKind.JOINT
        if of_two and not change.words("other"):
            raise UsageError(
                "channel_swap of a joint needs the other joint",
                where=where,
                next_step=f"type channel_swap@{change.target}:channels=i,other=JOINT",
            )
        if not of_two and len(change.words("channels")) != 2:
            raise UsageError(
                "channel_swap needs two channels", where=where, next_step="type channels=fx+fy"
            )


def joints_of(change: Change, robot: Robot) -> tuple[str, ...]:
    """Return the joints that a change of joints concerns, ``all`` spelt out."""
    return robot.tree.joint_names if change.target == ALL else (change.target,)


def feet_of(change: Change, robot: Robot) -> tuple[str, ...]:
    """Return the feet that a change of feet concerns, ``all`` spelt out."""
    return tuple(robot.feet) if change.target == ALL else (change.target,)
