# SPDX-License-Identifier: Apache-2.0
"""What a check has found."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How bad a finding is."""

    INFO = "info"
    """Good to know."""
    WARNING = "warning"
    """Probably not meant; results may be wrong."""
    ERROR = "error"
    """Cannot be; results would be wrong."""


@dataclass(frozen=True)
class Finding:
    """One finding of a check.

    Parameters
    ----------
    level : Level
    what : str
        What was found, in one sentence without a full stop.
    where : str
        File, link, joint, sensor or foot.
    measured, limit : str
        The number found, with its unit, and the number it had to respect.
    next_step : str
        What the reader should do about it.
    """

    level: Level
    what: str
    where: str = ""
    measured: str = ""
    limit: str = ""
    next_step: str = ""
