# SPDX-License-Identifier: Apache-2.0
"""The pose plan shipped with the 14-joint biped: two feet, left foot, right foot, hanging.

The rows were taken from many random balanced poses so that together they determine every link
moment that foot wrenches can see, and are ordered for short moves.
"""

from __future__ import annotations

import numpy as np

from comcal.measure.plan import DOUBLE, NONE, PlannedPose
from comcal_sims.robots.biped14.model import Biped14Parameters, biped14_spec
from comcal_sims.robots.biped14.poses import (
    JointAngles,
    SwingLeg,
    UpperBody,
    double_pose,
    single_pose,
)

# pelvis x, y, z, roll, pitch; left foot ahead; waist roll, pitch; left, right shoulder
_DOUBLE = (
    (0.00, 0.00, 0.76, 0.00, 0.00, 0.0, 0.00, 0.00, 0.0, 0.0),
    (0.12, 0.02, 0.74, 0.02, 0.00, 0.2, -0.40, -0.25, 0.5, 0.5),
    (-0.02, 0.04, 0.64, -0.15, 0.00, 0.0, -0.15, 0.60, -0.1, 0.4),
    (-0.05, 0.00, 0.71, 0.00, 0.35, -0.2, 0.40, -0.15, -0.2, 0.3),
    (-0.08, 0.00, 0.63, 0.00, 0.35, -0.2, -0.35, -0.10, 0.5, 0.2),
    (-0.09, 0.00, 0.70, 0.00, 0.35, 0.2, 0.25, 0.40, -1.2, 0.6),
    (0.06, 0.00, 0.65, 0.00, 0.25, 0.2, -0.35, -0.15, -2.1, 0.6),
    (0.05, -0.05, 0.63, -0.14, 0.00, 0.0, -0.35, -0.20, -2.0, -0.2),
    (-0.04, -0.02, 0.78, -0.07, 0.00, -0.2, -0.20, -0.10, -2.4, 0.7),
    (-0.08, 0.05, 0.78, 0.11, 0.00, 0.0, 0.35, 0.55, -2.2, 0.6),
    (0.00, 0.00, 0.79, 0.00, 0.30, -0.2, 0.35, 0.50, -1.8, -1.2),
    (-0.06, 0.00, 0.76, 0.00, 0.20, 0.0, 0.15, -0.30, -0.8, -1.0),
    (-0.06, 0.01, 0.66, 0.12, 0.00, -0.2, 0.40, -0.25, -0.5, -1.6),
    (0.03, 0.00, 0.69, 0.00, 0.35, -0.1, -0.35, -0.25, 0.0, -2.2),
    (-0.02, 0.00, 0.78, 0.00, 0.25, 0.2, -0.30, 0.60, 0.5, -2.4),
    (-0.04, -0.08, 0.77, -0.08, 0.00, 0.1, -0.35, 0.70, 0.3, -1.0),
    (0.08, -0.01, 0.63, -0.05, 0.00, 0.2, -0.40, 0.55, -2.4, -2.1),
)

# CoM x, y from the standing ankle; pelvis z, roll, pitch; waist roll, pitch; left, right shoulder;
# swing leg: hip roll, pitch, knee, ankle pitch, roll
_LEFT = (
    (-0.01, -0.005, 0.79, -0.10, 0.25, -0.40, 0.50, -1.3, 0.1, -0.30, 0.3, 0.2, 0.4, -0.3),
    (0.03, 0.010, 0.74, -0.08, -0.05, -0.35, 0.50, -2.3, 0.4, -0.35, -0.9, 1.2, 0.1, 0.3),
    (-0.03, 0.010, 0.75, 0.00, 0.30, -0.35, 0.15, -2.1, -1.3, -0.35, -1.3, 0.3, -0.6, 0.4),
    (0.02, 0.010, 0.69, 0.00, 0.05, 0.40, 0.60, -2.4, -1.8, -0.25, -1.4, 1.8, -0.4, 0.0),
    (0.03, 0.015, 0.76, -0.10, 0.20, -0.40, 0.15, -2.1, -2.1, -0.05, 0.4, 0.2, -0.8, 0.2),
    (-0.03, -0.010, 0.76, 0.10, -0.10, 0.15, 0.10, -0.2, -1.5, -0.35, -0.6, 0.1, -0.4, -0.4),
    (0.02, 0.005, 0.70, 0.00, 0.10, -0.30, 0.25, 0.0, -1.5, -0.40, -0.1, 1.2, 0.5, 0.4),
    (-0.01, 0.010, 0.68, -0.08, 0.20, -0.30, -0.30, 0.8, -2.3, -0.40, 0.5, 1.3, 0.0, 0.1),
    (-0.01, -0.015, 0.72, -0.04, -0.10, 0.00, 0.00, 0.1, -2.3, -0.35, -0.2, 1.9, -0.2, -0.4),
    (-0.01, -0.010, 0.69, -0.10, 0.25, -0.15, 0.50, 0.4, -1.9, -0.40, -0.2, 1.9, -0.7, 0.3),
)
_RIGHT = (
    (0.05, 0.005, 0.70, -0.08, 0.20, -0.40, 0.00, -0.2, 0.2, 0.40, 0.0, 1.1, 0.3, 0.4),
    (0.01, 0.005, 0.70, 0.08, 0.20, 0.25, -0.30, 0.6, 0.4, 0.30, 0.5, 0.5, -0.6, -0.4),
    (0.06, 0.005, 0.68, 0.06, 0.05, 0.35, 0.60, 0.5, 0.5, 0.35, -1.3, 0.1, 0.2, 0.1),
    (0.02, -0.015, 0.67, 0.10, 0.25, 0.25, -0.05, -0.7, -0.9, 0.30, -1.4, 0.1, 0.5, 0.2),
    (0.02, -0.005, 0.76, 0.04, 0.25, 0.35, 0.15, -2.2, -1.3, 0.20, -0.9, 1.7, 0.4, -0.3),
    (0.00, -0.015, 0.69, -0.10, -0.10, 0.35, 0.50, -2.1, -2.3, 0.35, 0.1, 1.9, -0.8, 0.2),
    (0.00, -0.005, 0.68, 0.10, 0.30, 0.40, 0.15, -1.8, -0.8, 0.25, 0.5, 0.8, -0.7, 0.3),
    (0.04, 0.010, 0.72, 0.08, 0.30, 0.20, 0.30, 0.6, -2.3, 0.40, 0.1, 1.9, -0.5, 0.0),
    (0.02, -0.005, 0.75, 0.08, 0.05, -0.30, -0.15, -0.1, -2.3, 0.35, -1.3, 1.4, -0.8, -0.3),
    (0.06, 0.000, 0.76, -0.02, 0.20, -0.30, 0.20, 0.5, -0.5, 0.35, -1.4, 1.9, -0.8, -0.4),
)

# waist roll, pitch; left, right shoulder; left, then right hip roll, pitch, knee, ankle pitch, roll
_HANGING = (
    (0.0, 0.0, -0.5, 0.5, 0.1, -0.4, 0.8, -0.4, 0.1, -0.1, 0.3, 0.4, 0.2, -0.1),
    (0.3, 0.4, -1.5, -0.2, 0.4, -1.2, 0.3, 0.5, 0.3, 0.0, 0.5, 1.5, -0.8, 0.3),
    (-0.3, 0.8, -2.2, -1.6, 0.0, 0.6, 1.2, -0.8, -0.4, -0.4, -1.4, 0.5, 0.4, -0.3),
    (0.2, -0.4, 0.6, -2.4, 0.3, -1.5, 1.9, 0.0, 0.4, -0.3, -0.8, 1.9, 0.6, 0.4),
)


def biped14_plan(parameters: Biped14Parameters) -> tuple[PlannedPose, ...]:
    """Return about 40 statically balanced poses, in the joint order of the robot.

    Raises
    ------
    UsageError
        If lengths or masses of *parameters* make one of the poses impossible.
    """
    names = biped14_spec(parameters).joint_names
    poses: list[tuple[str, JointAngles]] = [
        (
            DOUBLE,
            double_pose(
                parameters, x, y, z, roll=roll, pitch=pitch, ahead=ahead, upper=UpperBody(*upper)
            ),
        )
        for x, y, z, roll, pitch, ahead, *upper in _DOUBLE
    ]
    for foot, rows in (("left", _LEFT), ("right", _RIGHT)):
        for x, y, z, roll, pitch, *rest in rows:
            q = single_pose(
                parameters,
                foot[0],
                (x, y),
                z,
                roll=roll,
                pitch=pitch,
                upper=UpperBody(*rest[:4]),
                swing=SwingLeg(*rest[4:]),
            )
            poses.append((foot, q))
    poses += [(NONE, _hanging(row)) for row in _HANGING]
    return tuple(
        PlannedPose(number, np.array([q[name] for name in names]) + 0.0, support)  # no -0
        for number, (support, q) in enumerate(poses, start=1)
    )


def _hanging(row: tuple[float, ...]) -> JointAngles:
    left, right = SwingLeg(*row[4:9]).angles("l"), SwingLeg(*row[9:]).angles("r")
    return UpperBody(*row[:4]).angles() | left | right
