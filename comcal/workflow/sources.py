# SPDX-License-Identifier: Apache-2.0
"""Finding a source by its name among the entry points of the group ``comcal.sources``."""

from __future__ import annotations

import re
from collections.abc import Callable
from difflib import get_close_matches
from importlib.metadata import PackageNotFoundError, entry_points, requires
from typing import cast

from comcal.errors import MissingExtraError, UsageError
from comcal.measure.source import SimulatedSource, SourceRequest

GROUP = "comcal.sources"
OWN_PACKAGES = ("comcal", "comcal_sims", "comcal_drivers")


def source_names() -> tuple[str, ...]:
    """Return the names of all installed sources."""
    return tuple(sorted({entry.name for entry in entry_points(group=GROUP)}))


def open_source(name: str, request: SourceRequest) -> SimulatedSource:
    """Open the source called *name*; its package is imported now and not before.

    Parameters
    ----------
    name : str
        Name of the entry point, without argument.
    request : SourceRequest

    Raises
    ------
    UsageError
        If there is no such source, or it measures only and cannot move a robot.
    MissingExtraError
        If a package that it needs is not installed.
    """
    entry = next(iter(entry_points(group=GROUP, name=name)), None)
    if entry is None:
        names = source_names()
        near = get_close_matches(name, names, n=1)
        raise UsageError(
            f"there is no source {name!r}",
            where="--source",
            next_step=(f"did you mean {near[0]}? " if near else "")
            + f"there are: {', '.join(names) or 'none'}",
        )
    try:
        factory = cast("Callable[[SourceRequest], SimulatedSource]", entry.load())
        source = factory(request)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if not missing or missing in OWN_PACKAGES:
            raise
        raise MissingExtraError(
            f"the source {name} needs the package {missing}, which is not installed",
            where=f"--source {name}",
            next_step=f"type: pip install '{_extra_with(missing)}'",
        ) from error
    if not callable(getattr(source, "move_to", None)):
        source.close()
        raise UsageError(
            f"the source {name} measures but cannot move the robot",
            where=f"--source {name}",
            next_step=f"use one that can: {', '.join(n for n in source_names() if n != name)}",
        )
    return source


def _extra_with(package: str) -> str:
    """Return what to install: the extra of comcal that contains *package*, else itself."""
    try:
        requirements = requires("comcal") or []
    except PackageNotFoundError:
        return package
    for requirement in requirements:
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", requirement)
        if extra and re.match(rf"{re.escape(package)}\b", requirement, re.IGNORECASE):
            return f"comcal[{extra.group(1)}]"
    return package
