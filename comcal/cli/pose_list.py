# SPDX-License-Identifier: Apache-2.0
"""Pose numbers as they are typed: ``4,7,31-60``."""

from __future__ import annotations

import re

import click

PART = re.compile(r"(\d+)(?:-(\d+))?")


def pose_numbers(text: str, option: str) -> list[int]:
    """Return the numbers of a list such as ``4,7,31-60``.

    Parameters
    ----------
    text : str
    option : str
        For messages.

    Raises
    ------
    click.UsageError
        If it is not such a list.

    Examples
    --------
    >>> pose_numbers("4, 7-9", "--held-out")
    [4, 7, 8, 9]
    """
    poses: list[int] = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        found = PART.fullmatch(part)
        if found is None:
            raise click.UsageError(f"{option} {text!r}: give pose numbers as 4,7,31-60")
        first = int(found[1])
        poses += range(first, int(found[2] or first) + 1)
    return poses
