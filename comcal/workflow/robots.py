# SPDX-License-Identifier: Apache-2.0
"""Generated robots, found by name among the entry points of the group ``comcal.robots``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from math import isfinite
from pathlib import Path
from typing import cast

from comcal.errors import MissingExtraError, UsageError

GROUP = "comcal.robots"


def robot_names() -> tuple[str, ...]:
    """Return the names of all generated robots that are installed."""
    return tuple(sorted({entry.name for entry in entry_points(group=GROUP)}))


def robot_generator(name: str) -> Callable[..., Path]:
    """Return the function that writes robot *name* into a folder.

    Raises
    ------
    UsageError
        If there is no such robot.
    MissingExtraError
        If none is installed.
    """
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if not found:
        raise MissingExtraError(
            "no generated robot is installed",
            next_step="install the whole package: pip install comcal",
        )
    if name not in found:
        raise UsageError(
            f"there is no generated robot {name!r}",
            next_step=f"there are: {', '.join(sorted(found))}",
        )
    return cast("Callable[..., Path]", found[name].load())


def parameters_of(settings: Sequence[str]) -> dict[str, float | bool]:
    """Read ``KEY=VALUE`` settings: numbers in SI, or true and false.

    Raises
    ------
    UsageError
        If a setting is not of this form.
    """
    parameters: dict[str, float | bool] = {}
    for setting in settings:
        key, _, text = setting.partition("=")
        words = {"true": True, "false": False}
        try:
            value = words[text.lower()] if text.lower() in words else float(text)
            if not isfinite(value):
                raise ValueError(text)
        except ValueError:
            raise UsageError(
                f"{setting!r} is not KEY=NUMBER",
                where="--set",
                next_step="write SI numbers, or true and false, as in --set r_b=0.01",
            ) from None
        parameters[key.strip()] = value
    return parameters
