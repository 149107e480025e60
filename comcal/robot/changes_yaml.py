# SPDX-License-Identifier: Apache-2.0
"""``extended.yaml``: changes with how well they are known, the extension of a nominal model."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from ruamel.yaml import YAML

from comcal.errors import ConfigError, UsageError
from comcal.robot.changes import Change, Value, check_change, spec_of
from comcal.robot.changes_kinds import Key, KeyKind
from comcal.robot.effect_specs import effect_specs
from comcal.robot.locate import LocatedYaml, read_yaml
from comcal.robot.schema import Section, Text
from comcal.robot.units import Dimension, parse_quantity
from comcal.robot.validate import did_you_mean, validate_file

FORMAT = "comcal-extension/1"


@dataclass(frozen=True)
class KnownChange:
    """A change and the standard deviations of its parameters.

    Parameters
    ----------
    change : Change
    sigma : mapping from key to float
        In the unit of each parameter; keys without one are exact or words.
    """

    change: Change
    sigma: Mapping[str, float] = field(default_factory=dict[str, float])


class ParameterSection(Section):
    """One parameter: a number (or a list of poses or words), its sigma and its unit."""

    value: float | str | list[int] | list[str]
    sigma: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    unit: str | None = None


class EffectSection(Section):
    """One effect."""

    effect: Text
    target: str = ""
    parameters: dict[str, ParameterSection]


class ExtensionFile(Section):
    """The whole of ``extended.yaml``."""

    format: Literal["comcal-extension/1"]
    effects: list[EffectSection] = Field(default_factory=list[EffectSection])


class _Loose(ExtensionFile):
    """The same with further keys on top, such as those of a truth file."""

    model_config = ConfigDict(extra="ignore", frozen=True)


def read_extension(path: str | os.PathLike[str]) -> tuple[KnownChange, ...]:
    """Read ``extended.yaml``.

    Raises
    ------
    ConfigError
        If the file is missing or wrong: YAML, keys, units, names; file and line are named.
    """
    located = read_yaml(Path(path))
    if located.data.get("format") != FORMAT:
        raise ConfigError(
            f"is no extended.yaml: its format must be {FORMAT!r}",
            where=f"{path}:{located.line(['format'])}",
            measured=f"got {located.data.get('format')!r}",
            next_step="give one that comcal diagnose wrote: DIR/results/latest/extended.yaml",
        )
    return _changes(validate_file(located, ExtensionFile), located)


def changes_in(located: LocatedYaml) -> tuple[KnownChange, ...]:
    """Return the effects of a file that holds them among other things.

    Raises
    ------
    ConfigError
        As :func:`read_extension`.
    """
    entries = {"format": FORMAT, "effects": located.data.get("effects", [])}
    effects = LocatedYaml(located.path, entries, located.lines)
    return _changes(validate_file(effects, _Loose), located)


def extension_text(known: Sequence[KnownChange]) -> str:
    """Return the content of ``extended.yaml``."""
    yaml = YAML(pure=True)
    yaml.width = 4096
    stream = io.BytesIO()
    yaml.dump({"format": FORMAT, "effects": effects_data(known)}, stream)
    return stream.getvalue().decode("utf-8")


def effects_data(known: Iterable[KnownChange]) -> list[dict[str, object]]:
    """Return effects as maps, lists, words and numbers, as the file has them."""
    return [
        {
            "effect": entry.change.effect,
            "target": entry.change.target,
            "parameters": {
                key: _parameter_data(spec_of(entry.change.effect).keys[key], value, entry.sigma)
                for key, value in entry.change.parameters.items()
            },
        }
        for entry in known
    ]


def _parameter_data(key: Key, value: Value, sigma: Mapping[str, float]) -> dict[str, object]:
    data: dict[str, object] = {"value": list(value) if isinstance(value, tuple) else float(value)}
    if key.name in sigma and math.isfinite(sigma[key.name]):
        data["sigma"] = float(sigma[key.name])
    if key.unit:
        data["unit"] = key.unit
    return data


def _changes(file: ExtensionFile, located: LocatedYaml) -> tuple[KnownChange, ...]:
    return tuple(_change(section, i, located) for i, section in enumerate(file.effects))


def _change(section: EffectSection, i: int, located: LocatedYaml) -> KnownChange:
    where = located.where("effects", i)
    spec = effect_specs().get(section.effect)
    values, sigma = dict[str, Value](), dict[str, float]()
    for name, given in section.parameters.items():
        here = located.where("effects", i, "parameters", name)
        key = None if spec is None else spec.keys.get(name)
        if spec is None or key is None:
            what = (
                f"there is no effect {section.effect!r}"
                if spec is None
                else f"{section.effect} has no parameter {name!r}"
            )
            known = list(effect_specs() if spec is None else spec.keys)
            near = did_you_mean(section.effect if spec is None else name, known)
            raise ConfigError(what, where=here, next_step=near)
        values[name] = _value(key, given, here)
        if given.sigma is not None:
            sigma[name] = given.sigma
    change = Change(section.effect, section.target, values)
    try:
        check_change(change, where)
    except UsageError as problem:
        raise ConfigError(
            problem.what,
            where=where,
            measured=problem.measured,
            limit=problem.limit,
            next_step=problem.next_step,
        ) from problem
    return KnownChange(change, sigma)


def _value(key: Key, given: ParameterSection, where: str) -> Value:
    if given.unit is not None and given.unit != key.unit:
        raise ConfigError(
            f"{key.name} is in {key.unit or 'no unit'} here",
            where=where,
            measured=f"got {given.unit!r}",
            next_step="convert the value and its sigma",
        )
    value = given.value
    if isinstance(value, list):
        ids = [item for item in value if not isinstance(item, str)]
        return tuple(ids) if ids else tuple(str(item) for item in value)
    if key.kind is KeyKind.NUMBER:
        try:
            return parse_quantity(value, key.dimension or Dimension.RATIO)
        except ConfigError as problem:
            raise ConfigError(
                f"{key.name}: {problem.what}", where=where, measured=problem.measured
            ) from problem
    raise ConfigError(f"{key.name} must be a list", where=where, measured=f"got {value!r}")
