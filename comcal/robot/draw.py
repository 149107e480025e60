# SPDX-License-Identifier: Apache-2.0
"""A robot as it may have been built: its URDF, off by what ``tolerances`` call healthy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from comcal.robot.model import Robot


def draw_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """Draw a healthy robot of this design.

    Every component of every link CoM is normal with ``tolerances.link_com``, the mass of every link
    below a foot's cut with ``tolerances.link_mass``. Masses above the cuts stay: they are given,
    and what is found of a link with a wrong mass is not its CoM.

    Parameters
    ----------
    robot : Robot
        As designed.
    rng : numpy.random.Generator

    Returns
    -------
    Robot
        The same frames, joints and sensors.
    """
    below = links_below_cuts(robot)
    links = list(robot.tree.links)
    for k, link in enumerate(links):
        shift = robot.tolerances.link_com * rng.standard_normal(3)
        growth = 1.0 + robot.tolerances.link_mass * float(rng.standard_normal())
        mass = link.mass * growth if below[k] else link.mass
        links[k] = replace(link, mass=mass, com=link.com + shift)
    return replace(robot, tree=replace(robot.tree, links=tuple(links)))


def links_below_cuts(robot: Robot) -> npt.NDArray[np.bool_]:
    """Return which links lie below the cut of any foot's sensor, shape (n_links,)."""
    below = np.zeros(len(robot.tree.links), dtype=np.bool_)
    for foot in robot.feet.values():
        if foot.sensor is not None:
            below |= robot.below_cut[foot.sensor]
    return below
