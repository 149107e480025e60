# SPDX-License-Identifier: Apache-2.0
r"""The moment balance of a robot at rest, for N poses of one support at once.

With F, M the total wrench of the ground on the carried links, taken about the root origin in root
axes, and :math:`S = \sum_k m_k p_k + R_k h_k` the first moment of what is carried (p_k link
origin, h_k = m_k c_k the link's own first moment), equilibrium is

.. math:: |F| = m g, \qquad M = g\, S \times \hat f, \qquad \hat f = F / |F| .

No direction of gravity is assumed: each pose measures its own, as alpha .. delta of Muscolo 2017
(10)-(13) do, without M_2. The choice of frame and of root does not matter; the root frame is used
because there the derivatives with respect to joint angles are plain cross products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from comcal.robot.frames import apply, cross, skew
from comcal.robot.kinematics import Placements, place_links
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType, Tree
from comcal.statics.joint_slopes import joint_slopes
from comcal.statics.stance import stance_frame
from comcal.statics.support import Carrier
from comcal.statics.wrenches import wrench_transform


@dataclass(frozen=True)
class Balance:
    """Everything the balance of N poses needs, at given joint angles and wrenches.

    Parameters
    ----------
    q : array, shape (N, n_joints)
    w : array, shape (N, n_sensors, 6)
        Loaded wrenches, ground on robot, in and about each sensor's frame.
    placements : Placements
        In the root frame.
    X : array, shape (N, n_sensors, 6, 6)
        Takes each loaded sensor's wrench to the root frame.
    wrench_each : array, shape (N, n_sensors, 6)
        The loaded wrenches in and about the root frame [N, N m].
    up : array, shape (N, 3), or None
        What stands for the direction of gravity where no foot does: a vector of any length that
        points up, in the frame of ``up_link`` (an IMU's specific force).
    """

    robot: Robot
    carrier: Carrier
    q: Array
    w: Array
    placements: Placements
    X: Array
    wrench_each: Array
    up: Array | None = None
    up_link: int = 0

    @cached_property
    def motion(self) -> JointMotion:
        """Which independent joint moves which joint of the tree."""
        return joint_motion(self.robot.tree)

    def select(self, poses: npt.NDArray[np.intp]) -> Balance:
        """Return the balance of some of the poses."""
        at = self.placements
        return replace(
            self,
            q=self.q[poses],
            w=self.w[poses],
            placements=Placements(at.tree, at.R[poses], at.p[poses]),
            X=self.X[poses],
            wrench_each=self.wrench_each[poses],
            up=None if self.up is None else self.up[poses],
        )

    @property
    def F(self) -> Array:
        """Total force, shape (N, 3) [N]."""
        return self.wrench_each[..., :3].sum(axis=1)

    @property
    def M(self) -> Array:
        """Total moment about the root origin, shape (N, 3) [N m]."""
        return self.wrench_each[..., 3:].sum(axis=1)

    @property
    def direction(self) -> Array:
        """Unit vector up, in the root frame: of the total force, or of ``up``; shape (N, 3)."""
        v = self.F if self.up is None else apply(self.placements.R[:, self.up_link], self.up)
        return v / np.linalg.norm(v, axis=1, keepdims=True)


def balance_at(
    robot: Robot,
    carrier: Carrier,
    q: Array,
    w: Array,
    up: Array | None = None,
    up_link: int = 0,
    placements: Placements | None = None,
) -> Balance:
    """Bring the loaded wrenches of N poses to the root frame.

    Parameters
    ----------
    q : array, shape (N, n_joints)
    w : array, shape (N, n_sensors, 6)
        Ground on robot, in and about each sensor's frame.
    up : array, shape (N, 3), optional
        Upward vector of hanging poses in the frame of *up_link*.
    up_link : int
    placements : Placements, optional
        Of all links at *q*, where they are known already.
    """
    placements = place_links(robot.tree, q) if placements is None else placements
    X = _to_root(robot, carrier, placements)
    each = np.einsum("nsij,nsj->nsi", X, w)
    return Balance(robot, carrier, q, w, placements, X, each, up, up_link)


def _to_root(robot: Robot, carrier: Carrier, at: Placements) -> Array:
    """Return what takes each loaded wrench to the root frame, shape (N, n_sensors, 6, 6)."""
    frames = [
        stance_frame(robot, carrier.support, at) if k is None else (at.R[:, k], at.p[:, k])
        for k in carrier.frames
    ]
    if not frames:
        return np.zeros((len(at.p), 0, 6, 6))
    return np.stack([wrench_transform(R, p) for R, p in frames], axis=1)


def first_moments(balance: Balance, h: Array, masses: Array | None = None) -> Array:
    """Return the first moment of every carried link about the root origin, (N, n_links, 3) [kg m].

    Parameters
    ----------
    h : array, shape (n_links, 3)
        m_k c_k of every link in its own frame [kg m]; links below the cut contribute nothing.
    masses : array, shape (n_links,), optional
        Link masses [kg], by default the URDF's.
    """
    at = balance.placements
    s = at.p * (at.tree.masses if masses is None else masses)[:, None] + apply(at.R, h)
    return s * balance.carrier.carried[:, None]


def residual(balance: Balance, mass: float, h: Array, masses: Array | None = None) -> Array:
    """Return what is left of the balance, shape (N, 4): force [N], then moment [N m].

    Parameters
    ----------
    balance : Balance
    mass : float
        Mass of what is carried [kg].
    h : array, shape (n_links, 3)
        First moments of the links in their own frames [kg m].
    masses : array, shape (n_links,), optional
        Link masses that place the first moments [kg], by default the URDF's.
    """
    g = balance.robot.gravity
    S = first_moments(balance, h, masses).sum(axis=1)
    force = np.linalg.norm(balance.F, axis=1) - mass * g
    moment = balance.M - g * cross(S, balance.direction)
    return np.concatenate([force[:, None], moment], axis=1)


def moment_regressor(
    balance: Balance, direction: Array, links: Sequence[int] | None = None
) -> Array:
    """Return d(residual moment)/d(h_k), shape (N, 3, n_links, 3) [m/s^2]; zero below the cut.

    Parameters
    ----------
    balance : Balance
    direction : array, shape (N, 3)
        Unit vector of the ground reaction in the root frame; that of *balance* or a steadier one.
    links : sequence of int, optional
        Only these links, in this order.
    """
    at = slice(None) if links is None else list(links)
    A = (balance.robot.gravity * skew(direction))[:, None] @ balance.placements.R[:, at]
    A *= balance.carrier.carried[at, None, None]
    return np.swapaxes(A, 1, 2)


@dataclass(frozen=True)
class JointMotion:
    """How the independent joints move the tree.

    Parameters
    ----------
    joint : array of int, shape (n_moving,)
        Index in the tree of every joint that moves.
    drive : array, shape (n_moving, n_joints)
        Speed of each of them per speed of each independent joint: 1, or a mimic's multiplier.
    prismatic : array of bool, shape (n_moving,)
    """

    joint: npt.NDArray[np.intp]
    drive: Array
    prismatic: npt.NDArray[np.bool_]


def joint_motion(tree: Tree) -> JointMotion:
    """Return which independent joint moves which joint of *tree*."""
    column = {name: i for i, name in enumerate(tree.joint_names)}
    moving = [k for k, joint in enumerate(tree.joints) if joint.is_movable]
    drive = np.zeros((len(moving), len(column)))
    for row, k in enumerate(moving):
        mimic = tree.joints[k].mimic
        leader = mimic.joint if mimic else tree.joints[k].name
        drive[row, column[leader]] = mimic.multiplier if mimic else 1.0
    prismatic = [tree.joints[k].kind is JointType.PRISMATIC for k in moving]
    return JointMotion(np.array(moving, np.intp), drive, np.array(prismatic, np.bool_))


def input_jacobian(balance: Balance, h: Array, masses: Array | None = None) -> tuple[Array, Array]:
    """Return the derivatives of :func:`residual` with respect to everything that was measured.

    Parameters
    ----------
    h : array, shape (n_links, 3)
    masses : array, shape (n_links,), optional
        By default the URDF's [kg].

    Returns
    -------
    B_w : array, shape (N, 4, n_sensors, 6)
        With respect to each loaded wrench in its own sensor frame.
    B_q : array, shape (N, 4, n_joints)
        With respect to each joint position: it turns what lies beyond the joint, links and
        sensors alike.
    """
    tree, at = balance.robot.tree, balance.placements
    g, f = balance.robot.gravity, balance.direction
    size = np.linalg.norm(balance.F, axis=1)
    s = first_moments(balance, h, masses)
    S = s.sum(axis=1)

    across = (np.eye(3) - f[:, :, None] * f[:, None, :]) / size[:, None, None]
    B_FM = np.zeros((len(f), 4, 6))
    B_FM[:, 0, :3] = f
    B_FM[:, 1:, :3] = -g * skew(S) @ across
    B_FM[:, 1:, 3:] = np.eye(3)
    B_w = np.swapaxes(B_FM[:, None] @ balance.X, 1, 2)

    motion = balance.motion
    beyond = tree.descendants[motion.joint + 1].astype(np.float64)
    axis, origin = at.axes()[:, motion.joint], at.p[:, motion.joint + 1]
    m_beyond = beyond @ ((tree.masses if masses is None else masses) * balance.carrier.carried)
    S_beyond = beyond @ s
    on_link = [s for s, k in enumerate(balance.carrier.frames) if k is not None]
    links = [k for k in balance.carrier.frames if k is not None]
    W_beyond = beyond[:, links] @ balance.wrench_each[:, on_link]
    F_beyond, M_beyond = W_beyond[..., :3], W_beyond[..., 3:]

    slides = motion.prismatic[:, None]
    dF = np.where(slides, 0.0, cross(axis, F_beyond))
    dM_turn = cross(axis, M_beyond) - cross(cross(axis, origin), F_beyond)
    dM = np.where(slides, cross(axis, F_beyond), dM_turn)
    dS_turn = cross(axis, S_beyond - m_beyond[:, None] * origin)
    dS = np.where(slides, m_beyond[:, None] * axis, dS_turn)

    per_joint = B_FM[:, :, :3] @ np.swapaxes(dF, 1, 2)
    per_joint[:, 1:] += np.swapaxes(dM - g * cross(dS, f[:, None]), 1, 2)
    B_q = per_joint @ motion.drive
    if len(on_link) < len(balance.carrier.frames):
        B_q += B_FM @ world_plate_slopes(balance)
    return B_w, B_q


def world_plate_slopes(balance: Balance) -> Array:
    """Return d(wrench of plates in the world, in the root frame)/dq, shape (N, 6, n_joints).

    Such a plate measures in P, which follows all standing feet at once.
    """
    robot, carrier = balance.robot, balance.carrier
    in_world = [s for s, k in enumerate(carrier.frames) if k is None]

    def total(q: Array) -> Array:
        X = _to_root(robot, carrier, place_links(robot.tree, q))[:, in_world]
        w = np.tile(balance.w[:, in_world], (len(q) // len(balance.q), 1, 1))
        return np.einsum("nsij,nsj->ni", X, w)

    return joint_slopes(total, balance.q)
