# SPDX-License-Identifier: Apache-2.0
"""Which joints of the left side have a twin on the right."""

from __future__ import annotations

import re

from comcal.robot.model import Robot
from comcal.robot.standing import side_of

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_SIDES = {"l": "left", "r": "right"}


def mirrored_joints(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Return (left, right) names of the independent joints that differ in the side alone.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of (str, str)
        In the order of the joints of the left; empty where names tell no sides.
    """
    by_name = {(side_of(j), _without_side(j)): j for j in robot.tree.joint_names if side_of(j)}
    return tuple(
        (joint, by_name["right", rest])
        for (side, rest), joint in by_name.items()
        if side == "left" and ("right", rest) in by_name
    )


def _without_side(name: str) -> tuple[str, ...]:
    words = [word.lower() for word in _WORD.findall(name)]
    return tuple(w for w in words if _SIDES.get(w, w) not in _SIDES.values())
