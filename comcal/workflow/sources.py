# SPDX-License-Identifier: Apache-2.0
"""Finding a source by its name among the entry points of the group ``comcal.sources``."""

from __future__ import annotations

from typing import cast

from comcal.errors import UsageError
from comcal.measure.source import SimulatedSource, Source, SourceRequest
from comcal.workflow.extensions import extension_names, make_extension

GROUP = "comcal.sources"


def source_names() -> tuple[str, ...]:
    """Return the names of all installed sources."""
    return extension_names(GROUP)


def open_measuring(name: str, request: SourceRequest) -> Source:
    """Open the source called *name*, whether or not it also moves a robot.

    Parameters
    ----------
    name : str
        Name of the entry point, without argument.
    request : SourceRequest

    Raises
    ------
    UsageError
        If there is no such source.
    MissingExtraError
        If a package that it needs is not installed.
    """
    return make_extension(GROUP, name, request, Source, "source")


def moves_itself(source: Source) -> bool:
    """Whether a source is its own commander, as a simulated world is."""
    return callable(getattr(source, "move_to", None))


def open_source(name: str, request: SourceRequest) -> SimulatedSource:
    """Open a source that moves what it measures.

    Parameters
    ----------
    name : str
        Name of the entry point, without argument.
    request : SourceRequest

    Raises
    ------
    UsageError
        If there is no such source, or it measures only.
    MissingExtraError
        If a package that it needs is not installed.
    """
    source = open_measuring(name, request)
    if not moves_itself(source):
        source.close()
        raise UsageError(
            f"the source {name} measures but cannot move the robot",
            where=f"--source {name}",
            next_step=f"use one that can: {', '.join(n for n in source_names() if n != name)}",
        )
    return cast("SimulatedSource", source)
