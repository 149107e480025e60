# SPDX-License-Identifier: Apache-2.0
"""Loading what other packages add, by its name among the entry points of a group."""

from __future__ import annotations

import re
from collections.abc import Callable
from difflib import get_close_matches
from importlib.metadata import PackageNotFoundError, entry_points, requires
from typing import TypeVar, cast

from comcal.errors import MissingExtraError, UsageError

OWN_PACKAGES = ("comcal", "comcal_sims", "comcal_drivers")

Made = TypeVar("Made")


def extension_names(group: str) -> tuple[str, ...]:
    """Return the names of everything installed in an entry-point group."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


def make_extension(group: str, name: str, request: object, made: type[Made], kind: str) -> Made:
    """Call the entry point called *name*; its package is imported now and not before.

    Parameters
    ----------
    group : str
        Of entry points, such as ``comcal.sources``.
    name : str
    request : object
        What it is called with.
    made : type
        What it returns; told, not checked.
    kind : str
        ``source`` or ``commander``, for messages; also the name of the option.

    Raises
    ------
    UsageError
        If there is no such entry point.
    MissingExtraError
        If a package that it needs is not installed.
    """
    entry = next(iter(entry_points(group=group, name=name)), None)
    if entry is None:
        names = extension_names(group)
        near = get_close_matches(name, names, n=1)
        raise UsageError(
            f"there is no {kind} {name!r}",
            where=f"--{kind}",
            next_step=(f"did you mean {near[0]}? " if near else "")
            + f"there are: {', '.join(names) or 'none'}",
        )
    try:
        factory = cast("Callable[[object], Made]", entry.load())
        return factory(request)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if not missing or missing in OWN_PACKAGES:
            raise
        raise MissingExtraError(
            f"the {kind} {name} needs the package {missing}, which is not installed",
            where=f"--{kind} {name}",
            next_step=f"type: pip install '{_extra_with(missing)}'",
        ) from error


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
