# SPDX-License-Identifier: Apache-2.0
"""What a pose must keep to be planned, and which rule refused how many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from comcal.plan.avoid import Avoided
from comcal.plan.clearance import CLEARANCE, heights
from comcal.plan.collision import Collisions, collisions_of
from comcal.plan.loads import effort_shares
from comcal.plan.motion import sole_motion
from comcal.plan.settle import JointBox, joint_box
from comcal.plan.solids import Solids, solids_of
from comcal.plan.stand import Stand, stand_of
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.tree import Array

EFFORT_SHARE = 0.8
"""Of a motor's effort that a pose may take: the model that says so is not calibrated yet."""
REASONS = ("stance not reached", "motor effort", "floor", "collision", "to be avoided")
"""Why candidates are refused, in the order in which they are asked."""


@dataclass(frozen=True)
class Rules:
    """Everything that a pose must keep.

    Parameters
    ----------
    robot : Robot
    stands : mapping from support to Stand
    box : JointBox
    solids : Solids
    collisions : Collisions
    avoided : Avoided
    """

    robot: Robot
    stands: dict[str, Stand]
    box: JointBox
    solids: Solids
    collisions: Collisions
    avoided: Avoided = field(default_factory=Avoided)

    def broken(self, support: str, q: Array) -> npt.NDArray[np.intp]:
        """Return the index in ``REASONS`` of the first rule that each pose breaks, -1 for none.

        Parameters
        ----------
        support : str
        q : array, shape (N, n_joints)
            Poses that stand in *support*.
        """
        stand = self.stands[support]
        reason = np.full(len(q), -1, np.intp)
        at = sole_motion(self.robot, stand.feet[0], q)
        reason[np.abs(effort_shares(stand, at)).max(axis=1, initial=0.0) > EFFORT_SHARE] = 1
        low = heights(stand, at, self.solids.solids) < CLEARANCE
        reason[low & (reason < 0)] = 2
        avoid = self.avoided.holds(q, self.box)
        reason[avoid & (reason < 0)] = 4
        left = np.flatnonzero(reason < 0)
        placed = Placements(at.placements.tree, at.placements.R[left], at.placements.p[left])
        touching = ~self.collisions.free(placed)
        reason[left[touching]] = 3
        return reason


def rules_of(
    robot: Robot,
    supports: Sequence[str],
    *,
    margin: float,
    share: float = 1.0,
    avoided: Avoided | None = None,
) -> Rules:
    """Return the rules for poses of *robot*.

    Parameters
    ----------
    robot : Robot
    supports : sequence of str
        ``double`` or names of feet.
    margin : float
        Least distance of the CoM from the edges of the support polygon [m].
    share : float
        Middle share of every joint's range that may be used.
    avoided : Avoided or None

    Raises
    ------
    ConfigError
        As of :func:`~comcal.plan.stand.stand_of`.
    """
    solids = solids_of(robot)
    return Rules(
        robot,
        {support: stand_of(robot, support, margin) for support in supports},
        joint_box(robot.tree, share),
        solids,
        collisions_of(robot.tree, solids),
        avoided or Avoided(),
    )
