# SPDX-License-Identifier: Apache-2.0
"""Does the robot stand at q = 0, left foot left, soles down, its weight over its feet?"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from comcal.robot.findings import Finding, Level
from comcal.robot.model import Foot, Robot
from comcal.robot.soles import place_at_zero
from comcal.robot.tree import Array

STEP = 0.005
"""Soles of a standing robot are level with one another to this [m]."""
TILT = 0.02
"""... and level to this [rad]."""
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}


def check_standing(robot: Robot) -> tuple[Finding, ...]:
    """Check the feet of a robot as it stands at q = 0 with the z of its root up.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of Finding
        Empty for robots without feet.
    """
    if not robot.feet:
        return ()
    soles = {name: _sole_in_root(robot, foot) for name, foot in robot.feet.items()}
    return (
        *_check_unknown(robot),
        *_check_zero_is_allowed(robot),
        *_check_sides(robot, soles),
        *_check_level(soles),
        *_check_balance(robot, soles),
    )


def side_of(name: str) -> str:
    """Return ``left``, ``right`` or nothing, from a name such as ``l_foot`` or ``LeftSole``."""
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    sides = {_SIDES[word.lower()] for word in words if word.lower() in _SIDES}
    return sides.pop() if len(sides) == 1 else ""


def _sole_in_root(robot: Robot, foot: Foot) -> Array:
    """Return the sole frame in the root frame at q = 0, shape (4, 4)."""
    R, p = place_at_zero(robot.tree).link(foot.link)
    T_root_link = np.eye(4)
    T_root_link[:3, :3], T_root_link[:3, 3] = R[0], p[0]
    return T_root_link @ foot.T_link_sole


def _check_unknown(robot: Robot) -> Iterator[Finding]:
    """Say which feet have no outline and no ankle."""
    for name, foot in robot.feet.items():
        if foot.sole is None:
            yield Finding(
                Level.INFO,
                "the outline of its sole is not known, so balance cannot be predicted",
                where=f"foot {name}",
                next_step="write `sole:` with the corners in the sole frame",
            )
        if foot.ankle is None:
            yield Finding(
                Level.INFO,
                "no pitch joint was found above it, so twin poses cannot be planned",
                where=f"foot {name}",
                next_step="write `ankle:` if there is one",
            )


def _check_zero_is_allowed(robot: Robot) -> Iterator[Finding]:
    """Say which joints cannot be at zero."""
    for joint in robot.tree.joints:
        if joint.lower <= joint.upper and not joint.lower <= 0.0 <= joint.upper:
            yield Finding(
                Level.INFO,
                "q = 0 is outside its limits; standing at q = 0 is checked all the same",
                where=f"joint {joint.name}",
                measured="0",
                limit=f"{joint.lower:g} to {joint.upper:g}",
            )


def _check_sides(robot: Robot, soles: dict[str, Array]) -> Iterator[Finding]:
    """Check that what is called left is on the left."""
    for name, foot in robot.feet.items():
        other = {side_of(foot.link), side_of(foot.sensor or "")} - {side_of(name), ""}
        if side_of(name) and other:
            yield Finding(
                Level.WARNING,
                f"its link {foot.link!r} or sensor {foot.sensor!r} is called {other.pop()}",
                where=f"foot {name}",
                next_step="are left and right exchanged?",
            )
    left = [T[1, 3] for name, T in soles.items() if side_of(name) == "left"]
    right = [T[1, 3] for name, T in soles.items() if side_of(name) == "right"]
    if left and right and max(left) < min(right):
        yield Finding(
            Level.WARNING,
            "the left foot is on the right of the right foot",
            where=f"robot {robot.name}",
            measured=f"left at y = {max(left) * 1e3:.0f} mm, right at {min(right) * 1e3:.0f} mm",
            next_step="are left and right exchanged, or does the root's x point backwards?",
        )


def _check_level(soles: dict[str, Array]) -> Iterator[Finding]:
    """Check that the soles are level, and in one plane."""
    for name, T in soles.items():
        tilt = float(np.arctan2(np.hypot(T[0, 2], T[1, 2]), T[2, 2]))
        if tilt > TILT:
            yield Finding(
                Level.WARNING if tilt > 0.5 * np.pi else Level.INFO,
                "its sole points up at q = 0" if tilt > 0.5 * np.pi else "is not level at q = 0",
                where=f"foot {name}",
                measured=f"{np.degrees(tilt):.1f} deg",
                limit=f"{np.degrees(TILT):.1f} deg",
                next_step="check `sole_frame:`, whose z points away from the ground",
            )
    heights = [float(T[2, 3]) for T in soles.values()]
    if max(heights) - min(heights) > STEP:
        yield Finding(
            Level.INFO,
            "the soles are not at one height at q = 0",
            where="feet " + ", ".join(soles),
            measured=f"{(max(heights) - min(heights)) * 1e3:.1f} mm",
            limit=f"{STEP * 1e3:.0f} mm",
        )


def _check_balance(robot: Robot, soles: dict[str, Array]) -> Iterator[Finding]:
    """Check that the CoM at q = 0 is above the soles (above their bounding rectangle)."""
    outlines = [
        (soles[name] @ np.array([x, y, 0.0, 1.0]))[:2]
        for name, foot in robot.feet.items()
        if foot.sole is not None
        for x, y in foot.sole
    ]
    known = all(foot.sole is not None for foot in robot.feet.values())
    if not known or robot.tree.total_mass <= 0.0:
        return
    com = place_at_zero(robot.tree).total_com()[0]
    low, high = np.min(outlines, axis=0), np.max(outlines, axis=0)
    inside = min(float(edge) for edge in (*(com[:2] - low), *(high - com[:2])))
    yield Finding(
        Level.INFO if inside > 0.0 else Level.WARNING,
        "stands at q = 0" if inside > 0.0 else "would fall over at q = 0",
        where=f"robot {robot.name}",
        measured=f"centre of mass {abs(inside) * 1e3:.0f} mm"
        f" {'inside' if inside > 0.0 else 'outside'} the soles",
        next_step="" if inside > 0.0 else "check masses, CoMs and the frames of the feet",
    )
