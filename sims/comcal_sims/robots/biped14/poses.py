# SPDX-License-Identifier: Apache-2.0
"""Joint angles of standing and hanging postures of the 14-joint biped.

Without a hip yaw joint a leg with a flat foot ties the pelvis' yaw to its other angles: the leg
plane leaning sideways by a and the pelvis pitched by p ask for yaw = atan(tan(a) sin(p)). Standing
on one foot the solver turns the pelvis accordingly. On two feet both legs must ask for the same,
so either the pelvis is level in pitch, and may roll and shift at will, or its roll follows too.

Frame: the floor, x to the toes, y left, z up; in double support its origin is midway between the
ankles' feet, in single support below the ankle of the standing foot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from comcal.errors import UsageError
from comcal.robot.frames import rotation_from_rpy
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array
from comcal_sims.robots.biped14.model import SIDES, Biped14Parameters, biped14_spec
from comcal_sims.robots.leg import two_link_tilts

JointAngles = dict[str, float]

CLOSED = 1e-9
"""Largest yaw of a foot [rad] and CoM error [m] of a solved pose."""


@dataclass(frozen=True)
class UpperBody:
    """Angles of waist and shoulders [rad]."""

    waist_roll: float = 0.0
    waist_pitch: float = 0.0
    l_shoulder: float = 0.0
    r_shoulder: float = 0.0

    def angles(self) -> JointAngles:
        """Return them by joint name."""
        return dict(vars(self))


@dataclass(frozen=True)
class SwingLeg:
    """Angles of the leg that does not stand [rad]."""

    hip_roll: float = 0.0
    hip_pitch: float = -0.6
    knee: float = 1.2
    ankle_pitch: float = -0.6
    ankle_roll: float = 0.0

    def angles(self, side: str) -> JointAngles:
        """Return them by joint name."""
        return {f"{side}_{name}": angle for name, angle in vars(self).items()}


def leg_angles(
    parameters: Biped14Parameters, side: str, T_floor_pelvis: Array, ankle: Array
) -> tuple[JointAngles, float]:
    """Return the five angles that put a flat foot below *ankle*, and the yaw it would have.

    Parameters
    ----------
    parameters : Biped14Parameters
    side : str
        ``l`` or ``r``.
    T_floor_pelvis : array, shape (4, 4)
    ankle : array, shape (3,)
        Crossing of the ankle axes in the floor frame [m].

    Returns
    -------
    angles : dict from joint name to float
        [rad]
    yaw : float
        Sine of the angle by which the foot would point left of the floor's x axis: the pose exists
        only where it is zero.

    Raises
    ------
    UsageError
        If the leg does not reach.
    """
    R, p = T_floor_pelvis[:3, :3], T_floor_pelvis[:3, 3]
    hip = np.array([0.0, SIDES[side] * parameters.half_hip, 0.0])
    x, y, z = R.T @ (ankle - p) - hip
    hip_roll = float(np.arctan2(y, -z))
    shin, thigh = two_link_tilts(
        parameters.shin_length,
        parameters.thigh_length,
        -float(x),
        float(np.hypot(y, z)),
        where=f"{side}_leg",
    )
    # The foot is flat if R Rx(hip_roll) Ry(shin) Ry(ankle_pitch) Rx(ankle_roll) = 1.
    B = (R @ rotation_from_rpy([hip_roll, 0, 0]) @ rotation_from_rpy([0, shin, 0])).T
    angles = {
        f"{side}_hip_roll": hip_roll,
        f"{side}_hip_pitch": thigh,
        f"{side}_knee": shin - thigh,
        f"{side}_ankle_pitch": float(np.arctan2(-B[2, 0], B[0, 0])),
        f"{side}_ankle_roll": float(np.arctan2(-B[1, 2], B[1, 1])),
    }
    return angles, -float(B[1, 0])


def double_pose(
    parameters: Biped14Parameters,
    x: float = 0.0,
    y: float = 0.0,
    z: float = 0.76,
    *,
    roll: float = 0.0,
    pitch: float = 0.0,
    ahead: float = 0.0,
    upper: UpperBody = UpperBody(),
) -> JointAngles:
    """Return the closed chain of both legs for a wanted pelvis pose over two flat feet.

    Parameters
    ----------
    parameters : Biped14Parameters
    x, y, z : float
        Pelvis origin in the floor frame [m].
    roll, pitch : float
        Of the pelvis [rad]. With a pitch the nearest roll (and the yaw) that closes the chain is
        taken instead of *roll*.
    ahead : float
        x of the left foot minus x of the right foot [m].
    upper : UpperBody

    Raises
    ------
    UsageError
        If a leg does not reach, or no yaw and roll close the chain.
    """

    def legs(unknown: Array) -> tuple[JointAngles, Array]:
        T = _pelvis(x, y, z, float(unknown[0]), pitch, float(unknown[1]))
        angles, yaws = JointAngles(), list[float]()
        for side, sign in SIDES.items():
            ankle = np.array(
                [sign * ahead / 2, sign * parameters.half_hip, parameters.ankle_height]
            )
            found, yaw = leg_angles(parameters, side, T, ankle)
            angles |= found
            yaws.append(yaw)
        return angles, np.array(yaws)

    angles, _ = legs(_solve(lambda u: legs(u)[1], np.array([roll, 0.0]), "double support"))
    return angles | upper.angles()


def single_pose(
    parameters: Biped14Parameters,
    stand: str,
    com: tuple[float, float] = (0.02, 0.0),
    z: float = 0.75,
    *,
    roll: float = 0.0,
    pitch: float = 0.0,
    upper: UpperBody = UpperBody(),
    swing: SwingLeg = SwingLeg(),
) -> JointAngles:
    """Return the pose on one foot whose CoM is above a wanted point of the sole.

    Parameters
    ----------
    parameters : Biped14Parameters
    stand : str
        ``l`` or ``r``.
    com : tuple of 2 float
        CoM in the floor frame [m], whose origin is below the standing ankle.
    z, roll, pitch : float
        Pelvis height [m] and angles [rad].
    upper : UpperBody
    swing : SwingLeg
        Of the other leg; whether it clears the floor is not checked here.

    Raises
    ------
    UsageError
        If the standing leg does not reach, or no pelvis position balances.
    """
    spec = biped14_spec(parameters)
    tree = spec.tree()
    free = swing.angles("r" if stand == "l" else "l") | upper.angles()
    ankle = np.array([0.0, 0.0, parameters.ankle_height])

    def stance(unknown: Array) -> tuple[JointAngles, Array]:
        x, y, yaw = (float(value) for value in unknown)
        T = _pelvis(x, y, z, roll, pitch, yaw)
        angles, foot_yaw = leg_angles(parameters, stand, T, ankle)
        angles |= free
        q = np.array([angles[name] for name in spec.joint_names])
        p = T[:3, :3] @ place_links(tree, q).total_com()[0] + T[:3, 3]
        return angles, np.array([p[0] - com[0], p[1] - com[1], foot_yaw])

    start = np.array([com[0], com[1] - 0.6 * SIDES[stand] * parameters.half_hip, 0.0])
    angles, _ = stance(_solve(lambda u: stance(u)[1], start, f"{stand}_foot support"))
    return angles


def _pelvis(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Array:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy([roll, pitch, yaw])
    T[:3, 3] = x, y, z
    return T


def _solve(residual: Callable[[Array], Array], start: Array, where: str) -> Array:
    solution = least_squares(residual, start, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    worst = float(np.abs(solution.fun).max())
    if worst > CLOSED:
        raise UsageError(
            "no pose of the pelvis closes this stance",
            where=where,
            measured=f"{worst:.1e} rad or m are left",
            limit=f"{CLOSED:.0e}",
            next_step="ask for less pitch, roll or reach",
        )
    return solution.x
