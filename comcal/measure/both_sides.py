# SPDX-License-Identifier: Apache-2.0
"""Every planned pose twice, each joint arriving once from either side.

Play, hysteresis and stiction turn their sign with the side from which a joint comes. Two rows of
one pose, with opposite ``approach.<joint>`` and one ``revisit``, show them, and their mean is free
of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comcal.errors import UsageError
from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import NOT_MOVED

BOTH = "both"
"""Value of ``--approach``, and of ``approach`` in session.yaml."""

DEFAULT_VIA = float(np.radians(3.0))
"""How far beyond its place a joint goes first [rad]: more than gears play and wind up."""


def both_sides(plan: Sequence[PlannedPose], joint_names: Sequence[str]) -> tuple[PlannedPose, ...]:
    """Return a plan in which every pose stands twice, approached from opposite sides.

    Parameters
    ----------
    plan : sequence of PlannedPose
        In the order of driving.
    joint_names : sequence of str
        In the order of ``q``.

    Returns
    -------
    tuple of PlannedPose
        Pose N becomes 2 N, approached from the side where the robot comes from (or that the plan
        demands), then 2 N + 1, approached from the other side. Ids grow with time, so that clocks
        do. Both have the ``revisit`` of pose N, or its number where it has none. A joint that does
        not move between two poses has no side.

    Raises
    ------
    UsageError
        If an id is negative.
    """
    found: list[PlannedPose] = []
    before: PlannedPose | None = None
    for pose in plan:
        if pose.pose < 0:
            raise UsageError(
                "poses approached from both sides need ids of zero or more",
                where=f"pose {pose.pose}",
                next_step="number the plan anew",
            )
        sides = _natural_sides(pose, before, joint_names)
        revisit = pose.revisit or f"pose {pose.pose}"
        first = replace(pose, pose=2 * pose.pose, approach=sides, revisit=revisit)
        opposite = {joint: -side for joint, side in sides.items()}
        found += [first, replace(first, pose=2 * pose.pose + 1, approach=opposite)]
        before = pose
    return tuple(found)


def _natural_sides(
    pose: PlannedPose, before: PlannedPose | None, joint_names: Sequence[str]
) -> dict[str, int]:
    """Return +1 or -1 of every joint that moves to *pose*; before the first, it stands straight."""
    step = pose.q - (np.zeros_like(pose.q) if before is None else before.q)
    sides: dict[str, int] = {}
    for joint, way in zip(joint_names, step.tolist(), strict=True):
        demanded = pose.approach.get(joint)
        if demanded is not None:
            sides[joint] = demanded
        elif abs(way) >= NOT_MOVED:
            sides[joint] = 1 if way > 0.0 else -1
        elif before is None:
            sides[joint] = 1
    return sides
