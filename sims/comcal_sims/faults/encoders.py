# SPDX-License-Identifier: Apache-2.0
"""How far joints are from where their encoders say they are, before any load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from comcal.measure.plan import PlannedPose
from comcal.measure.pose_row import approaches
from comcal.robot.changes import Change
from comcal.robot.model import Robot
from comcal.robot.tree import Array


def approach_signs(
    robot: Robot, pose: PlannedPose, previous: PlannedPose | None
) -> Mapping[str, int]:
    """Return from which side each joint comes, as the recording notes it: +1, -1 or 0.

    Before its first pose a robot stands straight.
    """
    names = robot.tree.joint_names
    known = approaches(pose, previous, names)
    straight = {name: int(np.sign(q)) for name, q in zip(names, pose.q.tolist(), strict=True)}
    return {name: straight[name] if sign is None else sign for name, sign in known.items()}


def encoder_errors(
    robot: Robot, changes: Sequence[Change], q: Array, approach: Mapping[str, int]
) -> Array:
    """Return joint minus encoder: zero offsets, lag and eccentricity.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
    q : array, shape (n_joints,)
        What the encoders read [rad] or [m].
    approach : mapping from joint name to int

    Returns
    -------
    array, shape (n_joints,)
        [rad] or [m]

    Notes
    -----
    ``hysteresis`` is play in the coupling of the encoder: its shaft is dragged along and stays
    behind the joint by half_width, so the joint is ahead on the side to which it moved.
    """
    names = robot.tree.joint_names
    errors = np.zeros(len(names))
    for change in changes:
        if change.effect == "joint_offset":
            errors[names.index(change.target)] += change.number("offset")
        elif change.effect == "hysteresis":
            side = approach[change.target]
            errors[names.index(change.target)] += change.number("half_width") * side
        elif change.effect == "unknown" and change.words("function") == ("eccentricity",):
            i = names.index(change.target)
            errors[i] += change.number("amplitude") * np.sin(q[i] + change.number("phase"))
    return errors
