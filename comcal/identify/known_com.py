# SPDX-License-Identifier: Apache-2.0
"""The CoM components of a pose table that were known by other means, as a list of equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError, MissingColumnError
from comcal.measure.table import PoseTable
from comcal.robot.tree import Array, Tree

FRAMES = ("P",)
"""Frames besides that of the root link in which a component may be given."""


@dataclass(frozen=True)
class KnownCom:
    """One entry per known component, in the order of the poses.

    Parameters
    ----------
    q : array, shape (N, n_joints)
        Joint positions of the poses [rad] or [m].
    q_var : array, shape (N, n_joints)
        Their variances.
    pose : tuple of int, length N
        Ids of the poses.
    row : array of int, shape (n_eq,)
        Row of ``q`` to which each equation belongs.
    component : array of int, shape (n_eq,)
        0, 1, 2 for x, y, z.
    com, com_var : array, shape (n_eq,)
        Value [m] and variance [m^2].
    """

    q: Array
    q_var: Array
    pose: tuple[int, ...]
    row: npt.NDArray[np.intp]
    component: npt.NDArray[np.intp]
    com: Array
    com_var: Array

    def __len__(self) -> int:
        return len(self.com)

    def pick(self, B: Array) -> Array:
        """Return the rows of ``B(q)``, shape (..., N, 3, n_par), that these components take."""
        return B[..., self.row, self.component, :]


def known_com(table: PoseTable, tree: Tree) -> KnownCom:
    """Collect every CoM component that *table* gives.

    Raises
    ------
    MissingColumnError
        If a pose has none.
    ConfigError
        If they are given in a frame that does not stand still with the root link.
    """
    root = tree.links[0].name
    if table.com_frame not in (*FRAMES, root):
        raise ConfigError(
            f"com is given in the frame {table.com_frame!r}",
            limit=f"the frame of the root link {root!r}, or P",
            next_step="root the chain at that link",
        )
    is_known = np.isfinite(table.com)
    if not bool(is_known.any(axis=1).all()):
        i = int(np.flatnonzero(~is_known.any(axis=1))[0])
        raise MissingColumnError(
            "no CoM component is given for this pose",
            where=table.where(i),
            next_step="give com.x, com.y or com.z, or set `use` to 0",
        )
    row, component = np.nonzero(is_known)
    com_var = table.com_var[row, component]
    return KnownCom(
        q=table.q,
        q_var=np.where(np.isfinite(table.q_cov), table.q_cov, 0.0),
        pose=table.pose,
        row=row,
        component=component,
        com=table.com[row, component],
        com_var=np.where(np.isfinite(com_var), com_var, 0.0),
    )
