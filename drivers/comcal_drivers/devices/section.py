# SPDX-License-Identifier: Apache-2.0
"""What all sections of device files have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _number(value: object) -> object:
    """Return the number that a key such as ``0x080`` stands for; keys of YAML files are text."""
    try:
        return int(value, 0) if isinstance(value, str) else value
    except ValueError:
        return value


Number = Annotated[int, BeforeValidator(_number)]
"""An integer; as a key it may be hexadecimal."""
Byte = Annotated[int, Field(ge=0, le=255)]


class Section(BaseModel):
    """Keys that are not known are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)
