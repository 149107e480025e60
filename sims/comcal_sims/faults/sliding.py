# SPDX-License-Identifier: Apache-2.0
"""A body inside a link that slides along a rail, held by a spring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comcal.measure.plan import PlannedPose
from comcal.robot.changes import Change
from comcal.robot.kinematics import place_links
from comcal.robot.model import Robot
from comcal_sims.footing import base_in_world


def slid(robot: Robot, changes: Sequence[Change], pose: PlannedPose) -> Robot:
    """Return the robot with the CoMs of such links moved along their x axis.

    By the amplitude [m] where x points down, and in proportion to gravity along x elsewhere.

    Parameters
    ----------
    robot : Robot
    changes : sequence of Change
        ``unknown@LINK:function=sliding_mass`` count.
    pose : PlannedPose
        Where the robot is going to stand.
    """
    sliding = [
        c for c in changes if c.effect == "unknown" and c.words("function") == ("sliding_mass",)
    ]
    if not sliding:
        return robot
    R_world_base = base_in_world(robot, pose)[:3, :3]
    at = place_links(robot.tree, pose.q)
    links = list(robot.tree.links)
    for change in sliding:
        k = robot.tree.link_index[change.target]
        down = -float((R_world_base @ at.R[0, k])[2, 0])
        way = change.number("amplitude") * down
        links[k] = replace(links[k], com=links[k].com + np.array([way, 0.0, 0.0]))
    return replace(robot, tree=replace(robot.tree, links=tuple(links)))
