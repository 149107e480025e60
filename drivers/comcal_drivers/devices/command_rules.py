# SPDX-License-Identifier: Apache-2.0
"""How a device file says which frames start and question the device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field, model_validator

from comcal.errors import ConfigError
from comcal_drivers.devices.section import Byte, Number, Section


class DataField(Section):
    """Bytes of a command that come from a value: a loop variable, an id key, a setting."""

    value: str
    type: Literal["u8", "i8", "u16le", "u16be", "u32le", "u32be", "f32le", "f32be"] = "u8"
    scale: float = 1.0
    """What is sent is ``round(value * scale)`` for integers."""


class DataSum(Section):
    """The sum of all bytes before."""

    sum: Literal["u8", "u16le", "u16be"]


class Reply(Section):
    """An answer: a message of the DBC, and signals that must have given values to be this one."""

    message: str
    match: Mapping[str, int | str] = Field(default_factory=dict)
    """Signal to number, or to the name of a loop variable."""


class Step(Section):
    """One frame of a command, its repetitions and its answers."""

    id: int
    """As in the DBC; moved by ``ids`` unless ``shift`` says otherwise."""
    shift: Mapping[str, int] | None = None
    """Other shifts of the id keys for this frame."""
    data: tuple[Byte | DataField | DataSum, ...] = ()
    pad: int = Field(0, ge=0, le=64)
    """With zeros to this many bytes; more than eight are sent as several frames."""
    repeat: Mapping[str, tuple[int, ...]] = Field(default_factory=dict)
    """Loop variable (one at most) and its values."""
    replies: tuple[Reply, ...] = ()
    timeout: float = Field(0.5, gt=0.0)


class Gives(Section):
    """What a command tells: ``signals`` of its answers, appended over its repetitions."""

    signals: tuple[str, ...]
    scale: float = 1.0
    table: Mapping[Number, float] | None = None
    """Code to value, instead of ``scale``: units."""
    text: bool = False
    """The signals are characters."""

    @model_validator(mode="after")
    def _one_reading(self) -> Gives:
        if self.text and self.table is not None:
            raise ConfigError("a value is either `text` or looked up in a `table`")
        return self


class Command(Section):
    """Frames that make the device do or tell something."""

    steps: tuple[Step, ...]
    gives: Mapping[str, Gives] = Field(default_factory=dict)
    """Name of a device value (``matrix``, ``full_scale``, ``serial`` ...) to where it stands."""
    wait: float = Field(0.0, ge=0.0)
    """Pause after the last answer before the next command [s]."""
