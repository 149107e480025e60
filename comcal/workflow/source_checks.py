# SPDX-License-Identifier: Apache-2.0
"""What ``sources:`` of robot.yaml says, looked at without opening anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches

from comcal.errors import MissingExtraError
from comcal.measure.source import SourceRequest
from comcal.robot.findings import Finding, Level
from comcal.robot.model import Robot
from comcal.workflow.extensions import extension_names, make_extension
from comcal.workflow.sources import source_names

GROUP = "comcal.source_checks"
"""Entry points called like a source; what they name takes a :class:`SourceRequest` and returns
lines of text, and raises a ConfigError where the options are wrong."""


def check_sources(robot: Robot) -> tuple[Mapping[str, Sequence[str]], tuple[Finding, ...]]:
    """Return what every described source understands of its options, line by line.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    understood : mapping from source to sequence of str
    findings : tuple of Finding
        Sections of sources that do not exist, or whose packages are not installed.

    Raises
    ------
    ConfigError
        If the options of a source are wrong.
    """
    understood: dict[str, Sequence[str]] = {}
    findings: list[Finding] = []
    known, checked = source_names(), extension_names(GROUP)
    for name, options in robot.sources.items():
        where = f"sources.{name}"
        if name not in known:
            near = get_close_matches(name, known, n=1)
            what = f"there is no source {name!r}"
            step = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
            findings.append(Finding(Level.WARNING, what, where, next_step=step))
        elif name in checked:
            request = SourceRequest(robot, 0, options=options)
            try:
                understood[name] = make_extension(GROUP, name, request, tuple, "source")
            except MissingExtraError as missing:
                what, step = "it was not looked at", missing.next_step
                findings.append(Finding(Level.INFO, what, where, next_step=step))
    return understood, tuple(findings)
