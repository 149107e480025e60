# SPDX-License-Identifier: Apache-2.0
"""What a sensor in the air feels: the weight of all that hangs below its cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.errors import DataError, UsageError
from comcal.measure.plan import NONE
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot, Sense
from comcal.robot.tree import Array

IMU_TOLERANCE = 0.05
"""The IMU's norm may differ from gravity by this part."""
ASSUMED_TILT = 0.02
"""Standard deviation of a base that is taken as upright [rad]."""
MOUNTING_TILT = 0.005
"""Standard deviation of the axes of an IMU in its link [rad]."""


@dataclass(frozen=True)
class Up:
    """Which way is up.

    Parameters
    ----------
    direction : array, shape (3,)
        Against gravity, in the root frame.
    sigma : float
        Standard deviation about either horizontal axis [rad].
    source : str
        How it is known, in words.
    """

    direction: Array
    sigma: float
    source: str


def up_of(robot: Robot, q: Array, imu: Array | None, support: str) -> Up:
    """Return which way is up: by the IMU, else by the sole that stands, else by the base.

    Parameters
    ----------
    robot : Robot
    q : array, shape (n_joints,)
    imu : array, shape (3,), or None
        Mean specific force in the IMU link frame [m/s^2].
    support : str
        ``none`` or the foot that stands, on level ground.

    Raises
    ------
    DataError
        If the IMU does not read gravity.
    """
    at = place_links(robot.tree, q)
    if imu is not None and robot.imu_link is not None and np.isfinite(imu).all():
        size = float(np.linalg.norm(imu))
        if abs(size / robot.gravity - 1.0) > IMU_TOLERANCE:
            raise DataError(
                "the IMU does not read gravity",
                where="imu",
                measured=f"{size:.3g} m/s^2",
                limit=f"{robot.gravity:.4g} m/s^2 +- {100 * IMU_TOLERANCE:.0f} %",
                next_step="give it in m/s^2, and hold the robot still",
            )
        sigma = float(np.hypot(MOUNTING_TILT, robot.noise.imu / robot.gravity))
        return Up(at.link(robot.imu_link)[0][0] @ imu / size, sigma, f"the IMU on {robot.imu_link}")
    if support != NONE and support in robot.feet:
        foot = robot.feet[support]
        normal = at.link(foot.link)[0][0] @ foot.T_link_sole[:3, 2]
        return Up(normal, ASSUMED_TILT, f"the sole of foot {support} on level ground")
    base = robot.tree.links[0].name
    return Up(np.array([0.0, 0.0, 1.0]), ASSUMED_TILT, f"{base} held upright")


def hanging_wrench(robot: Robot, sensor: str, q: Array, up: Up) -> tuple[Array, Array]:
    """Return the wrench that hangs from a sensor, as the sensor reports it, and how sure that is.

    Parameters
    ----------
    robot : Robot
    sensor : str
    q : array, shape (n_joints,)
    up : Up

    Returns
    -------
    wrench : array, shape (6,)
        Force, moment in and about the sensor frame, in the sensor's own sense [N, N m].
    sigma : array, shape (6,)
        From the tilt, and from the tolerances of mass and CoM of the links that hang.

    Raises
    ------
    UsageError
        If the robot is held below the cut: what the hold carries is not known.
    """
    below = robot.below_cut[sensor]
    if below[0]:
        raise UsageError(
            f"the base of the robot is below the cut of {sensor}, so what hangs there is unknown",
            where=f"--sensor {sensor}",
            next_step="take the sensor off and give --bare, or leave it out",
        )
    at = place_links(robot.tree, q)
    R, p = at.joint(robot.sensors[sensor].joint)
    masses = robot.tree.masses[below]
    arms = at.coms[0][below] - p[0]
    sign = 1.0 if robot.sensors[sensor].sense is Sense.ON_ROBOT else -1.0

    def felt(direction: Array) -> Array:
        forces = -robot.gravity * masses[:, None] * direction
        wrench = np.stack([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])
        return sign * (wrench @ R[0]).ravel()

    wrench = felt(up.direction)
    across = np.linalg.svd(up.direction[None])[2][1:]
    tilts = [felt(np.asarray(up.sigma * axis)) for axis in across]
    weight = robot.gravity * float(np.sqrt((masses**2).sum()))
    tolerances = robot.tolerances
    shape = np.repeat([0.0, weight * tolerances.link_com], 3)
    of_mass = tolerances.link_mass * wrench
    variance = np.sum([*(tilt**2 for tilt in tilts), shape**2, of_mass**2], axis=0)
    return wrench, np.sqrt(variance)
