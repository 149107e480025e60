# SPDX-License-Identifier: Apache-2.0
"""Planned poses: the rows of ``plan.csv``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from comcal.robot.tree import Array

DOUBLE = "double"
NONE = "none"


@dataclass(frozen=True)
class PlannedPose:
    """One row of ``plan.csv``.

    Parameters
    ----------
    pose : int
        Unique id.
    q : array, shape (n_joints,)
        Wanted joint positions [rad] or [m], in the order of ``tree.joint_names``.
    support : str
        ``double``, ``none``, or the name of the foot that stands.
    configuration : str
        Shape id; twin poses (one shape, tilted about the ankles) share it. Empty: none.
    tilt : float or None
        Tilt of that shape about the ankles [rad], positive toes-ward.
    approach : mapping from joint name to int
        +1: arrive with q increasing, -1: decreasing; joints not named are free.
    floor_roll, floor_pitch : float
        Slope on which the feet are to stand [rad], as in ``R_world_P = Ry(pitch) Rx(roll)``.
        Columns ``floor.roll`` and ``floor.pitch``.
    revisit : str
        Poses with an equal word here are repeats of one another. Empty: none.
    """

    pose: int
    q: Array
    support: str = DOUBLE
    configuration: str = ""
    tilt: float | None = None
    approach: Mapping[str, int] = field(default_factory=dict[str, int])
    floor_roll: float = 0.0
    floor_pitch: float = 0.0
    revisit: str = ""
