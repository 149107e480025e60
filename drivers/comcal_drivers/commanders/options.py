# SPDX-License-Identifier: Apache-2.0
"""``commanders.cia402`` of robot.yaml."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from comcal.robot.locate import Key, LocatedYaml, read_yaml
from comcal.robot.validate import validate_file

VelocityUnit = Literal["rpm", "counts/s"]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class JointOptions(_Section):
    """What differs from the rest for one joint."""

    velocity_unit: VelocityUnit | None = None


class Options(_Section):
    """How the drives are to be moved.

    Parameters
    ----------
    velocity_unit
        Unit of 0x6081: ``rpm`` of the motor or ``counts/s``; asked of the drive where it can tell,
        and compared with what stands here.
    max_acceleration
        [rad/s^2]; default: full speed after half a second.
    state_timeout, acknowledge_timeout
        How long a drive may take to change its state, and to take a target [s].
    quick_stop
        Written to 0x605A: 5 to 8 hold the position after a quick stop; without it a drive that
        would let go is refused.
    """

    velocity_unit: VelocityUnit | None = None
    max_acceleration: float | None = Field(None, gt=0.0)
    state_timeout: float = Field(1.0, gt=0.0, le=30.0)
    acknowledge_timeout: float = Field(0.5, gt=0.0, le=30.0)
    quick_stop: Literal[5, 6, 7, 8] | None = None
    joints: Mapping[str, JointOptions] = Field(default_factory=dict[str, JointOptions])


class _Commanders(_Section):
    cia402: Options


class _File(_Section):
    commanders: _Commanders


def read_options(options: Mapping[str, object], yaml_path: Path | None) -> Options:
    """Check the options.

    Parameters
    ----------
    options : mapping
        ``commanders.cia402``.
    yaml_path : Path or None
        robot.yaml, from which error messages get their line.

    Raises
    ------
    ConfigError
        With file and line, and the key that was probably meant.
    """
    data: dict[str, Any] = {"commanders": {"cia402": dict(options)}}
    lines = dict.fromkeys(_paths(data, ()), 1)
    if yaml_path is not None and yaml_path.is_file():
        lines |= read_yaml(yaml_path).lines
    located = LocatedYaml(yaml_path or Path("commanders.cia402"), data, lines)
    return validate_file(located, _File).commanders.cia402


def _paths(data: object, here: tuple[Key, ...]) -> list[tuple[Key, ...]]:
    """Return the paths of all keys."""
    if not isinstance(data, Mapping):
        return []
    items = [(str(key), value) for key, value in data.items()]
    return [p for key, value in items for p in ((*here, key), *_paths(value, (*here, key)))]
