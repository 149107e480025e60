# SPDX-License-Identifier: Apache-2.0
"""The static rows of a robot that stands on one link: its load, and torques under that load."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal.robot.bodies import place_bodies
from comcal.robot.tree import Array, Tree
from comcal.statics.regressor import TORQUES, WRENCH
from comcal.statics.wrenches import wrench_transform


def standing_rows(tree: Tree, q: npt.ArrayLike, rows: Array, link: str) -> Array:
    """Return static rows with the whole support acting on *link*.

    Parameters
    ----------
    tree : Tree
    q : array, shape (N, n_joints)
        The poses of *rows* [rad] or [m].
    rows : array, shape (N, 6 + n_joints, n_columns)
        Of :func:`comcal.statics.regressor.static_regressor`; any choice of its columns.
    link : str
        The only link that touches anything.

    Returns
    -------
    rows : array, shape (N, 6 + n_joints, n_columns)
        Wrench of the ground on the robot in and about the frame of *link* [N, N m]; torques
        [N m] or [N] of parent on child about or along +axis. With the link's direction up the same
        in all poses (it lies flat on one floor), its own first moment along that direction is not
        determined.
    """
    q = np.atleast_2d(np.asarray(q, dtype=np.float64))
    bodies, k = tree.bodies, tree.link_index[link]
    b, fixed = int(bodies.of_link[k]), bodies.T_leader_link[k]
    placed = place_bodies(bodies, q)
    R_root_body = placed[b, 1:].transpose(2, 1, 0)
    R_root_link = R_root_body @ fixed[:3, :3]
    p_root_link = placed[b, 0].T + R_root_body @ fixed[:3, 3]
    R_link_root = R_root_link.swapaxes(1, 2)
    p_link_root = -(R_link_root @ p_root_link[..., None])[..., 0]

    standing = np.empty_like(rows)
    standing[:, WRENCH] = wrench_transform(R_link_root, p_link_root) @ rows[:, WRENCH]
    standing[:, TORQUES] = rows[:, TORQUES]
    for i in np.flatnonzero(bodies.descendants[1:, b]):
        axis = placed[i + 1, 1:].transpose(2, 1, 0) @ bodies.axes[i]
        if bodies.slides[i]:  # works on the force; else on the moment about the joint's origin
            share = np.concatenate([axis, np.zeros_like(axis)], axis=1)
        else:
            share = np.concatenate([np.cross(placed[i + 1, 0].T, axis), axis], axis=1)
        load = share[:, None] @ rows[:, WRENCH]
        standing[:, 6 + bodies.columns[i]] -= bodies.multipliers[i] * load[:, 0]
    return standing
