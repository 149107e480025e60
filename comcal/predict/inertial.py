# SPDX-License-Identifier: Apache-2.0
"""What inertia demands of every link while the measured motion goes on.

By d'Alembert minus that demand is a load on the link, like any other from outside: it enters the
balance of the feet, the cuts and the joint torques in one and the same way.
"""

from __future__ import annotations

import numpy as np

from comcal.measure.inertia import inertial_loads
from comcal.measure.table import PoseTable
from comcal.robot.frames import apply, cross
from comcal.robot.model import Robot
from comcal.robot.tree import Array


def inertial_wrenches(robot: Robot, table: PoseTable, rest: str) -> Array | None:
    """Return the wrench that moves each link, in and about its frame, (N, n_links, 6) [N, N m].

    Parameters
    ----------
    robot : Robot
        Links with their URDF inertia; where the URDF has none, a link is a point mass at its CoM.
    table : PoseTable
        Whose columns ``qd.*``, ``qdd.*`` say how the joints moved; a cell that is empty is zero.
    rest : str
        The link that does not move: that of a standing foot, or of the held root.

    Returns
    -------
    array or None
        None where the table has no ``qdd.*`` column: nothing is known of any acceleration.
    """
    joints = robot.tree.joint_names
    if not any(f"qdd.{joint}" in table.motion for joint in joints):
        return None
    still = np.zeros(len(table))
    qd, qdd = (
        np.column_stack([np.nan_to_num(table.motion.get(f"{d}.{j}", still)) for j in joints])
        for d in ("qd", "qdd")
    )
    loads = inertial_loads(robot, table.q, qd, qdd, rest)
    R_link_rest = np.swapaxes(loads.R_rest_root[:, None] @ loads.placements.R, -1, -2)
    force, moment = apply(R_link_rest, loads.force), apply(R_link_rest, loads.moment)
    return np.concatenate([force, moment + cross(robot.tree.coms, force)], axis=-1)
