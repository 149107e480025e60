# SPDX-License-Identifier: Apache-2.0
"""Pose plans of the Table 1 robot."""

from __future__ import annotations

import numpy as np

from comcal.measure.plan import PlannedPose
from comcal_sims.robots.table1.model import Table1Parameters, table1_spec
from comcal_sims.robots.table1.poses import (
    JointAngles,
    lateral_pose,
    planar_pose,
    split_stance_pose,
)

SHAPES = {"straight": 0.0, "forward": 1.0, "backward": -1.0}
"""Configuration id and thigh tilt minus shin tilt, in units of the bend."""

_SHIN_THIGH_WAIST_DEG = ((0, 0, 30), (0, 0, -30), (20, -15, 25), (-15, 20, -25))
_ROLLS_DEG = (-6, -3, 3, 6)

_LEG = 0.9
"""Length of shin and thigh of Table 1, to which the stances below are scaled [m]."""
# left foot ahead, hips before the middle of the feet and above the ankles [m], waist tilt [rad]
_SPLIT = (
    (0.30, 0.15, 0.84, -0.5),
    (0.20, 0.15, 0.75, -0.5),
    (0.35, 0.15, 0.75, 0.5),
    (0.35, -0.05, 0.75, 0.5),
    (0.35, -0.15, 0.75, 0.0),
    (0.30, -0.15, 0.84, 0.0),
    (0.30, -0.15, 0.84, 0.5),
    (0.30, 0.15, 0.84, 0.5),
    (-0.30, 0.15, 0.84, -0.5),
    (-0.35, 0.15, 0.75, -0.5),
    (-0.30, 0.15, 0.84, 0.5),
    (-0.30, -0.15, 0.84, 0.0),
    (-0.30, -0.15, 0.84, 0.5),
    (-0.35, -0.15, 0.75, 0.0),
    (-0.35, -0.05, 0.75, 0.5),
)


def planar_twin_plan(
    parameters: Table1Parameters, bend: float, tilt: float, first: int = 1
) -> tuple[PlannedPose, ...]:
    """Return n + 1 = 3 shapes of the two-joint chain, each as a pair of twins.

    Parameters
    ----------
    parameters : Table1Parameters
    bend : float
        Tilt of the thigh minus tilt of the shin in the two bent shapes, either sense [rad].
    tilt : float
        Angle between the twins of a shape [rad], half to the heels and half to the toes.
    first : int
        Id of the first pose.

    Returns
    -------
    poses : tuple of 6 PlannedPose
        ``tilt`` is the absolute tilt of the shin (ankle angle zero: tilt zero).
    """
    poses = list[PlannedPose]()
    directions = (-0.5, 0.5)
    for shape, sense in SHAPES.items():
        for direction in directions:
            shin = direction * tilt - sense * bend / 2
            q = planar_pose(parameters, shin, shin + sense * bend)
            number = first + len(poses)
            poses.append(_pose(parameters, number, q, configuration=shape, tilt=shin))
        directions = directions[::-1]  # the next shape starts on the side where this one ended
    return tuple(poses)


def slope_plan(
    parameters: Table1Parameters, pitch: float, bend: float, first: int = 1
) -> tuple[PlannedPose, ...]:
    """Return the three shapes, each on level ground and on a floor sloping toes-down and toes-up.

    Parameters
    ----------
    parameters : Table1Parameters
    pitch : float
        Slope either way [rad], in ``R_world_P = Ry(pitch)``.
    bend : float
        As in :func:`planar_twin_plan` [rad].
    first : int
        Id of the first pose.
    """
    poses = list[PlannedPose]()
    for shape, sense in SHAPES.items():
        q = planar_pose(parameters, -sense * bend / 2, sense * bend / 2)
        for floor_pitch in (0.0, pitch, -pitch):
            number = first + len(poses)
            poses.append(_pose(parameters, number, q, configuration=shape, floor_pitch=floor_pitch))
    return tuple(poses)


def table1_plan(parameters: Table1Parameters) -> tuple[PlannedPose, ...]:
    """Return the plan shipped with the robot: twins, waist pitch, split stances.

    The twins serve Cramer's rule. Only when the legs differ do the links of one leg separate from
    those of the other: hence the split stances. In two-foot stances one direction still stays
    dark, the one that shifts moments across the links of both legs in proportion to their lengths.

    Raises
    ------
    UsageError
        If a leg of *parameters* is too unlike Table 1 to reach.
    """
    angles = [
        planar_pose(parameters, *np.deg2rad(tilts).tolist()) for tilts in _SHIN_THIGH_WAIST_DEG
    ]
    scale = (parameters.L_b + parameters.L_c) / _LEG
    angles += [
        split_stance_pose(
            parameters, scale * ahead, scale * hip_x, parameters.L_a + scale * hip_z, waist
        )
        for ahead, hip_x, hip_z, waist in _SPLIT
    ]
    if parameters.roll_joints:
        angles += [lateral_pose(parameters, roll) for roll in np.deg2rad(_ROLLS_DEG).tolist()]
    twins = planar_twin_plan(parameters, bend=np.deg2rad(40.0), tilt=np.deg2rad(35.0))
    others = (_pose(parameters, len(twins) + i, q) for i, q in enumerate(angles, start=1))
    return (*twins, *others)


def _pose(
    parameters: Table1Parameters,
    number: int,
    q: JointAngles,
    configuration: str = "",
    tilt: float | None = None,
    floor_pitch: float = 0.0,
) -> PlannedPose:
    return PlannedPose(
        pose=number,
        q=np.array([q[name] for name in table1_spec(parameters).joint_names]) + 0.0,  # no -0
        configuration=configuration,
        tilt=tilt,
        floor_pitch=floor_pitch,
    )
