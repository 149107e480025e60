# SPDX-License-Identifier: Apache-2.0
r"""Joint torques that hold a standing robot, and how much of the motors' effort they take.

The torque of parent on child about +axis holds what lies beyond the joint against gravity, less
what the ground does beyond it:

.. math:: \tau_j = a_j \cdot \Big[ \sum_k (c_k - o_j) \times m_k g \hat z
          - \sum_s \big( M_s - o_j \times F_s \big) \Big] .

With several feet on the ground the split of their loads is statically indeterminate: a robot's
controllers and its compliance decide. Taken here is the split of least effort that also keeps
every foot's load upright and near the middle of its sole, which a stiff robot comes close to.
"""

from __future__ import annotations

import numpy as np

from comcal.plan.motion import SoleMotion
from comcal.plan.stand import Stand
from comcal.robot.tree import Array

FOOT_SHARE = 0.3
"""Weight of a foot's own moments and sideways forces against joint efforts in the split: 1 means a
load at the edge of its sole counts as a motor at its limit."""
SOLE_HALF = 0.05
"""Half the size of a sole [m] and half the friction coefficient in that weight."""


def effort_shares(stand: Stand, at: SoleMotion) -> Array:
    """Return the torque of every independent joint over its effort, shape (N, n_joints).

    Parameters
    ----------
    stand : Stand
    at : SoleMotion
        Balanced poses; the floor is level.

    Returns
    -------
    array, shape (N, n_joints)
        Signed; zero where the URDF gives no effort. A joint that drives mimics counts their load,
        too, against its own effort.
    """
    torques, by_split = _torques(stand, at)
    per_effort = 1.0 / _efforts(stand)
    shares = torques * per_effort
    if by_split.shape[2]:
        # Unknown: wrench of every foot but the first, in units of the robot's weight.
        rows = by_split * per_effort[:, None]
        feet, foot_offset = _foot_rows(stand, at)
        J = np.concatenate([rows, feet], axis=1)
        right = -np.concatenate([shares, foot_offset], axis=1)
        A = np.swapaxes(J, 1, 2) @ J
        A += 1e-9 * np.einsum("nii->n", A)[:, None, None] * np.eye(A.shape[1])
        split = np.linalg.solve(A, np.swapaxes(J, 1, 2) @ right[:, :, None])
        shares = shares + (rows @ split)[:, :, 0]
    return shares


def _efforts(stand: Stand) -> Array:
    tree = stand.robot.tree
    effort = np.array([tree.joints[tree.joint_index[n]].effort for n in tree.joint_names])
    # URDFs write 0 where nobody knows the effort.
    return np.where(effort > 0.0, effort, np.inf)


def _torques(stand: Stand, at: SoleMotion) -> tuple[Array, Array]:
    """Return torques with all the load on the first foot, and their change by the split."""
    tree = stand.robot.tree
    weight = tree.total_mass * stand.robot.gravity
    R, _ = at.sole(stand.feet[0])
    up = R[:, None, :, 2]
    m = at.beyond * tree.masses
    moment = np.cross(m @ at.placements.coms - m.sum(1)[:, None] * at.origin, up)
    force = np.broadcast_to(m.sum(axis=1)[:, None], at.axis.shape) * up
    on_first = at.beyond[:, _foot_link(stand, stand.feet[0])][:, None]
    com = at.placements.total_com()[:, None]
    moment -= on_first * tree.total_mass * np.cross(com - at.origin, up)
    force -= on_first * tree.total_mass * up
    slides = at.motion.prismatic
    g = stand.robot.gravity
    along = np.where(slides, np.sum(at.axis * force, -1), np.sum(at.axis * moment, -1))
    torques = g * along @ at.motion.drive

    columns = [np.zeros((len(torques), torques.shape[1], 0))]
    for foot in stand.feet[1:]:
        on_foot = at.beyond[:, _foot_link(stand, foot)][:, None].astype(np.float64)
        lever = (on_first - on_foot) * at.axis
        # A load at this foot's sole origin, taken off the first foot, in floor axes.
        _, p = at.sole(foot)
        by_force = np.where(slides[:, None], lever, np.cross(lever, p[:, None] - at.origin))
        by_moment = np.where(slides[:, None], 0.0, lever)
        both = np.concatenate([by_force @ R, by_moment @ R], axis=2)
        columns.append(weight * (at.motion.drive.T @ both))
    return torques, np.concatenate(columns, axis=2)


def _foot_rows(stand: Stand, at: SoleMotion) -> tuple[Array, Array]:
    """Return rows that keep every foot's load upright and centred, and their offsets."""
    n, others = len(at.axis), len(stand.feet) - 1
    com = at.com()
    scale = FOOT_SHARE / SOLE_HALF
    # Forces sideways and moments, of one foot in units of the weight; the first has what is left.
    keep = np.diag([scale, scale, 0.0, scale, scale, scale])
    first = np.zeros((n, 6, 6 * others))
    first_offset = np.zeros((n, 6))
    first_offset[:, 3], first_offset[:, 4] = com[:, 1], -com[:, 0]
    rows = np.zeros((n, 6 * others, 6 * others))
    for i, p in enumerate(stand.p[1:]):
        at_i = slice(6 * i, 6 * i + 6)
        rows[:, at_i, at_i] = keep
        first[:, :, at_i] = -np.eye(6)
        first[:, 3:, 6 * i : 6 * i + 3] -= np.array(
            [[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]]
        )
    J = np.concatenate([rows, keep @ first], axis=1)
    return J, np.concatenate([np.zeros((n, 6 * others)), first_offset @ keep], axis=1)


def _foot_link(stand: Stand, foot: str) -> int:
    return stand.robot.tree.link_index[stand.robot.feet[foot].link]
