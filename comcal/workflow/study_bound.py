# SPDX-License-Identifier: Apache-2.0
"""Cramer-Rao bounds that somebody else computed: a JSON file beside the study."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, cast

import numpy as np

from comcal.errors import ConfigError
from comcal.robot.tree import Array
from comcal.workflow.study_file import NoiseSection
from comcal.workflow.study_robot import StudyRobot

FORMAT = "comcal-crb/1"
NOISES = ("ft_force", "ft_moment", "encoder")
SAME = 1e-6
"""Largest relative difference of two noises that are the same."""


def read_bounds(path: Path) -> list[dict[str, Any]]:
    """Read the entries of a file of bounds.

    Raises
    ------
    ConfigError
        If it is missing or of another format.
    """
    try:
        content: object = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as problem:
        raise ConfigError(f"cannot be read: {problem}", where=str(path)) from problem
    entries = cast("dict[str, Any]", content) if isinstance(content, dict) else {}
    if entries.get("format") != FORMAT or not isinstance(entries.get("bounds"), list):
        raise ConfigError(f"is not of the format {FORMAT}", where=path.name)
    return entries["bounds"]


def bound_of(
    entries: list[dict[str, Any]], subject: StudyRobot, noise: NoiseSection, where: str
) -> Array:
    """Return the bound of every quantity of a robot, shape (n,) [kg], [m].

    Parameters
    ----------
    entries : list of dict
        As :func:`read_bounds` returns them.
    subject : StudyRobot
    noise : NoiseSection
        The bound has to be one for the same noise of a pose mean.
    where : str
        File and line that names the bounds.

    Raises
    ------
    ConfigError
        If there is no bound of this robot, noise, plan or quantity.
    """
    root = math.sqrt(noise.samples)
    means = (noise.ft_force / root, noise.ft_moment / root, noise.encoder)
    poses = [pose.pose for pose in subject.poses]
    for entry in entries:
        given = entry.get("noise", {})
        same = all(
            math.isclose(given.get(n, math.nan), m, rel_tol=SAME)
            for n, m in zip(NOISES, means, strict=True)
        )
        if entry.get("robot") == subject.name and entry.get("poses") == poses and same:
            sigma = entry.get("sigma", {})
            missing = [name for name in subject.quantities.names if name not in sigma]
            if missing:
                raise ConfigError(
                    f"no bound of {missing[0]} of {subject.name}",
                    where=where,
                    next_step="compute the bounds again",
                )
            return np.array([float(sigma[name]) for name in subject.quantities.names])
    raise ConfigError(
        f"no bound of {subject.name} with noise {noise.name!r} and these poses",
        where=where,
        next_step="compute the bounds again, or leave `crb:` out",
    )
