# SPDX-License-Identifier: Apache-2.0
"""What ``sources.bag`` of robot.yaml was understood to say, for ``comcal check``."""

from __future__ import annotations

from comcal.measure.source import SourceRequest
from comcal_drivers.bags.configuration import read_configuration


def describe_bag(request: SourceRequest) -> tuple[str, ...]:
    """Return which topics are read for which channel. Opens nothing.

    Parameters
    ----------
    request : SourceRequest

    Raises
    ------
    ConfigError
        As :func:`read_configuration`.
    """
    section = read_configuration(request.options, request.robot)
    named = [f"{channel}: {_listed(topics)}" for channel, topics in section.topics.items()]
    return (*named, "other channels are found by type and name")


def _listed(topics: str | list[str] | None) -> str:
    if topics is None:
        return "not read"
    return topics if isinstance(topics, str) else ", ".join(topics)
