# SPDX-License-Identifier: Apache-2.0
"""What a small move of a joint does to N placed poses: to forces, moments, and where up is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import cross
from comcal.robot.tree import Array
from comcal.statics.balance import Balance, JointMotion, world_plate_slopes


@dataclass(frozen=True)
class Moves:
    """The joints that move, placed: M of them, in N poses, in the root frame.

    Parameters
    ----------
    motion : JointMotion
    axis, origin : array, shape (N, M, 3)
        Unit axes, and joint origins [m].
    slides : array of bool, shape (M, 1)
    beyond : array, shape (M, n_links)
        1 where a link lies beyond the joint, else 0.
    """

    motion: JointMotion
    axis: Array
    origin: Array
    slides: npt.NDArray[np.bool_]
    beyond: Array

    def of_moments(self, mass: Array, first_moment: Array) -> Array:
        """Return d(first moment)/d(each joint) of what lies beyond it, shape (N, M, 3).

        Parameters
        ----------
        mass : array, shape (M,)
            Of the part beyond that counts [kg].
        first_moment : array, shape (N, M, 3)
            Of the same, about the root origin [kg m].
        """
        arm = first_moment - mass[:, None] * self.origin
        return np.where(self.slides, mass[:, None] * self.axis, cross(self.axis, arm))

    def of_wrenches(self, wrench: Array) -> Array:
        """Return d(wrench)/d(each joint) of sensors beyond it, about the root, shape (N, M, 6).

        Parameters
        ----------
        wrench : array, shape (N, M, 6)
            Sum of what those sensors measure, about the root origin [N, N m].
        """
        F, M = wrench[..., :3], wrench[..., 3:]
        turned = cross(self.axis, F)
        dF = np.where(self.slides, 0.0, turned)
        dM = cross(self.axis, M) - cross(cross(self.axis, self.origin), F)
        return np.concatenate([dF, np.where(self.slides, turned, dM)], axis=-1)


def moves_of(balance: Balance) -> Moves:
    """Return the moving joints of a balance, placed."""
    tree, at = balance.robot.tree, balance.placements
    motion = balance.motion
    return Moves(
        motion=motion,
        axis=at.axes()[:, motion.joint],
        origin=at.p[:, motion.joint + 1],
        slides=motion.prismatic[:, None],
        beyond=tree.descendants[motion.joint + 1].astype(np.float64),
    )


@dataclass(frozen=True)
class UpSlopes:
    """Derivatives of the direction of gravity with respect to what it is measured by.

    Parameters
    ----------
    by_wrench : array, shape (N, 3, n_sensors, 6)
        Each loaded wrench, in its own sensor's frame.
    by_joint : array, shape (N, 3, n_joints)
    by_up : array, shape (N, 3, 3)
        The upward vector of hanging poses, in its link's frame; zero for standing ones.
    """

    by_wrench: Array
    by_joint: Array
    by_up: Array


def up_slopes(balance: Balance, moves: Moves) -> UpSlopes:
    """Return how ``balance.direction`` reacts to every input."""
    f, carrier = balance.direction, balance.carrier
    n = len(f)
    if balance.up is not None:
        R = balance.placements.R[:, balance.up_link]
        size = np.linalg.norm(balance.up, axis=1)[:, None, None]
        across = (np.eye(3) - f[:, :, None] * f[:, None, :]) / size
        turns = moves.beyond[:, balance.up_link][:, None] * ~moves.slides
        by_joint = np.swapaxes(cross(moves.axis, f[:, None]) * turns, 1, 2)
        nothing = np.zeros((n, 3, len(carrier.sensors), 6))
        return UpSlopes(nothing, by_joint @ moves.motion.drive, across @ R)
    size = np.linalg.norm(balance.F, axis=1)[:, None, None]
    across = (np.eye(3) - f[:, :, None] * f[:, None, :]) / size
    by_wrench = np.swapaxes(across[:, None] @ balance.X[:, :, :3, :], 1, 2)
    dF = moves.of_wrenches(loads_beyond(balance, moves))[..., :3]
    by_joint = np.swapaxes(dF, 1, 2) @ moves.motion.drive
    if None in carrier.frames:
        by_joint = by_joint + world_plate_slopes(balance)[:, :3]
    return UpSlopes(by_wrench, across @ by_joint, np.zeros((n, 3, 3)))


def loads_beyond(balance: Balance, moves: Moves) -> Array:
    """Return the loaded wrenches of sensors on links beyond each joint, summed, (N, M, 6)."""
    on_link = [s for s, k in enumerate(balance.carrier.frames) if k is not None]
    links = [k for k in balance.carrier.frames if k is not None]
    return moves.beyond[:, links] @ balance.wrench_each[:, on_link]
