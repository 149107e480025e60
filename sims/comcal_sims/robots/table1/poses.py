# SPDX-License-Identifier: Apache-2.0
"""Joint angles of named postures of the Table 1 robot; every one has both soles flat.

Angles are absolute tilts of segments [rad], positive toes-ward (roll: positive to the right, as a
rotation about +x). Poses are mappings from joint name to angle.
"""

from __future__ import annotations

from comcal.errors import UsageError
from comcal_sims.robots.leg import two_link_tilts
from comcal_sims.robots.table1.model import SIDES, Table1Parameters

JointAngles = dict[str, float]


def planar_pose(
    parameters: Table1Parameters, shin: float, thigh: float, waist: float | None = None
) -> JointAngles:
    """Return the pose with both legs parallel in the sagittal plane.

    Parameters
    ----------
    parameters : Table1Parameters
    shin, thigh : float
        Absolute tilts [rad].
    waist : float, optional
        Absolute tilt of the waist [rad]; by default that of the thigh (hip joints at zero), so that
        thighs and waist are the one link c of the paper.
    """
    waist = thigh if waist is None else waist
    q = {f"{side}_{name}": angle for side in SIDES for name, angle in _leg(shin, thigh, waist)}
    return q | _rolls(parameters, 0.0)


def lateral_pose(
    parameters: Table1Parameters, roll: float, shin: float = 0.0, thigh: float = 0.0
) -> JointAngles:
    """Return a planar pose whose legs lean sideways as a parallelogram, the waist staying level.

    Parameters
    ----------
    parameters : Table1Parameters
        With ``roll_joints``.
    roll : float
        Rotation of both legs about +x [rad]: positive moves the waist to the right (-y).
    shin, thigh : float
        Tilts within the leaning leg planes [rad].

    Raises
    ------
    UsageError
        If the robot has no roll joints.
    """
    if not parameters.roll_joints:
        raise UsageError(
            "a lateral pose needs roll joints",
            where="table1",
            next_step="generate the robot with roll_joints=True",
        )
    q = {f"{side}_{name}": angle for side in SIDES for name, angle in _leg(shin, thigh, 0.0)}
    return q | _rolls(parameters, roll)


def split_stance_pose(
    parameters: Table1Parameters,
    ahead: float,
    hip_x: float,
    hip_height: float,
    waist: float = 0.0,
) -> JointAngles:
    """Return the closed chain with the left foot *ahead* of the right one, both soles flat.

    Parameters
    ----------
    parameters : Table1Parameters
    ahead : float
        x of the left ankle minus x of the right ankle [m].
    hip_x : float
        Both hips toes-ward of the middle between the ankles [m].
    hip_height : float
        Of both hips above the floor [m].
    waist : float
        Absolute tilt of the waist [rad].

    Raises
    ------
    UsageError
        If a leg is too short or too long to reach.
    """
    q = JointAngles()
    for side, sign in SIDES.items():
        dx = hip_x - sign * ahead / 2
        shin, thigh = two_link_tilts(
            parameters.L_b, parameters.L_c, dx, hip_height - parameters.L_a, where=f"{side}_leg"
        )
        q |= {f"{side}_{name}": angle for name, angle in _leg(shin, thigh, waist)}
    return q | _rolls(parameters, 0.0)


def _leg(shin: float, thigh: float, waist: float) -> tuple[tuple[str, float], ...]:
    return ("hip_pitch", thigh - waist), ("knee", shin - thigh), ("ankle_pitch", -shin)


def _rolls(parameters: Table1Parameters, roll: float) -> JointAngles:
    if not parameters.roll_joints:
        return {}
    return {
        f"{side}_{name}": angle
        for side in SIDES
        for name, angle in (("hip_roll", roll), ("ankle_roll", -roll))
    }
