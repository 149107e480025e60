# SPDX-License-Identifier: Apache-2.0
"""How soles and CoM of N poses move with the joints, seen from a standing sole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import apply
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array
from comcal.statics.balance import JointMotion, joint_motion


@dataclass(frozen=True)
class SoleMotion:
    """Robots placed in N poses, measured from the sole of one standing foot.

    Parameters
    ----------
    robot : Robot
    foot : str
        The standing foot whose sole frame is the floor frame: z up on level ground.
    placements : Placements
        In the root frame.
    motion : JointMotion
    axis, origin : array, shape (N, n_moving, 3)
        Of every moving joint, in the root frame [1], [m].
    beyond : array of bool, shape (n_moving, n_links)
        Links on the far side of each moving joint.
    """

    robot: Robot
    foot: str
    placements: Placements
    motion: JointMotion
    axis: Array
    origin: Array
    beyond: npt.NDArray[np.bool_]

    def sole(self, foot: str) -> tuple[Array, Array]:
        """Return axes (N, 3, 3) and origin (N, 3) of a sole frame in the root frame [m]."""
        R, p = self.placements.link(self.robot.feet[foot].link)
        T = self.robot.feet[foot].T_link_sole
        return R @ T[:3, :3], p + apply(R, T[:3, 3])

    def points(self, p_root: Array) -> Array:
        """Return points (N, k, 3) of the root frame in the floor frame [m]."""
        R, origin = self.sole(self.foot)
        return (p_root - origin[:, None]) @ R

    def com(self) -> Array:
        """Return the CoM of the whole robot in the floor frame, shape (N, 3) [m]."""
        return self.points(self.placements.total_com()[:, None])[:, 0]

    def com_jacobian(self) -> Array:
        """Return d(CoM in the floor frame)/dq, shape (N, 3, n_joints)."""
        tree, at = self.robot.tree, self.placements
        weight = self.beyond * (tree.masses / tree.total_mass)
        share = weight.sum(axis=1)[:, None]
        arm = weight @ at.coms - share * self.origin
        with_floor = self._moves(self.foot)[:, None]
        arm -= with_floor * (at.total_com()[:, None] - self.origin)
        slides = self.motion.prismatic[:, None]
        moved = np.where(slides, (share - with_floor) * self.axis, np.cross(self.axis, arm))
        return self._in_floor(moved)

    def relative_sole(self, foot: str) -> tuple[Array, Array]:
        """Return axes and origin of another sole in the floor frame, (N, 3, 3) and (N, 3) [m]."""
        R, p = self.sole(self.foot)
        R_other, p_other = self.sole(foot)
        R_floor_root = np.swapaxes(R, 1, 2)
        return R_floor_root @ R_other, apply(R_floor_root, p_other - p)

    def relative_sole_jacobian(self, foot: str) -> Array:
        """Return turn and shift of another sole per joint, floor axes, shape (N, 6, n_joints)."""
        _, p_other = self.sole(foot)
        sign = self._moves(foot)[:, None] - self._moves(self.foot)[:, None]
        slides = self.motion.prismatic[:, None]
        turn = np.where(slides, 0.0, sign * self.axis)
        arm = np.cross(self.axis, p_other[:, None] - self.origin)
        shift = sign * np.where(slides, self.axis, arm)
        return np.concatenate([self._in_floor(turn), self._in_floor(shift)], axis=1)

    def _moves(self, foot: str) -> Array:
        """Return 1 for joints that carry *foot* on their far side, shape (n_moving,)."""
        link = self.robot.tree.link_index[self.robot.feet[foot].link]
        return self.beyond[:, link].astype(np.float64)

    def _in_floor(self, per_joint: Array) -> Array:
        """Turn vectors (N, n_moving, 3) to floor axes and sum what one drive moves, (N, 3, nj)."""
        R, _ = self.sole(self.foot)
        return np.swapaxes(per_joint @ R, 1, 2) @ self.motion.drive


def sole_motion(robot: Robot, foot: str, q: Array) -> SoleMotion:
    """Place *robot* in N poses and prepare the derivatives.

    Parameters
    ----------
    robot : Robot
    foot : str
        Name of a standing foot.
    q : array, shape (N, n_joints)
    """
    at = place_links(robot.tree, q)
    motion = joint_motion(robot.tree)
    beyond = robot.tree.descendants[motion.joint + 1]
    axis, origin = at.axes()[:, motion.joint], at.p[:, motion.joint + 1]
    return SoleMotion(robot, foot, at, motion, axis, origin, beyond)
