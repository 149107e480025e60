# SPDX-License-Identifier: Apache-2.0
"""What robot.yaml says hangs below a cut, put in the place of what the URDF says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError
from comcal.robot.model import BelowCut, Robot, Sensor
from comcal.robot.soles import place_at_zero
from comcal.robot.tree import Array, Link, Tree


def replace_below_cuts(robot: Robot) -> Robot:
    """Return *robot* with the inertials that ``sensors.*.below`` states instead of the URDF's.

    The link next to the cut takes the whole mass, all others below it become pure frames. A
    subtree with joints of its own is thereby taken as rigid, in the shape it has at q = 0.

    Parameters
    ----------
    robot : Robot
        As the URDF has it. One without geometry (a chain) is returned as it is.

    Raises
    ------
    ConfigError
        If two sensors state the same links.
    """
    given = [sensor for sensor in robot.sensors.values() if sensor.below is not None]
    if not robot.tree.geometry_known:
        return robot
    for i, sensor in enumerate(given):
        for other in given[:i]:
            if (robot.below_cut[sensor.name] & robot.below_cut[other.name]).any():
                raise ConfigError(
                    "two sensors say what hangs below, and one cut is below the other",
                    where=f"sensors {other.name!r} and {sensor.name!r}",
                    next_step="give `below` of the one nearer to the ground only",
                )
    links = list(robot.tree.links)
    for sensor in given:
        _replace(links, robot, sensor)
    return replace(robot, tree=replace(robot.tree, links=tuple(links)))


def _replace(links: list[Link], robot: Robot, sensor: Sensor) -> None:
    """Write the one stated inertial of *sensor* into *links*."""
    below, mask, tree = sensor.below, robot.below_cut[sensor.name], robot.tree
    if below is None:
        return
    joint = tree.joints[tree.joint_index[sensor.joint]]
    near, com = tree.link_index[joint.child], below.com
    if not mask[near]:
        near = tree.link_index[joint.parent]
        com = joint.T_parent_joint[:3, :3] @ com + joint.T_parent_joint[:3, 3]
    inertia = _inertia_of(tree, mask, near, below)
    for k in np.flatnonzero(mask):
        links[k] = replace(
            links[k],
            mass=below.mass if k == near else 0.0,
            com=com if k == near else np.zeros(3),
            inertia=inertia if k == near else np.zeros((3, 3)),
            has_inertial=bool(k == near),
        )


def _inertia_of(tree: Tree, mask: npt.NDArray[np.bool_], near: int, below: BelowCut) -> Array:
    """Return the inertia of some links about their CoM, axes of link *near*, scaled to the mass.

    Statics never use it; engines need one that some body can have.
    """
    at = place_at_zero(tree)
    R, mass = at.R[0], np.where(mask, tree.masses, 0.0)
    total = float(mass.sum())
    if not total > 0.0:
        return np.zeros((3, 3))
    arm = at.coms[0] - mass @ at.coms[0] / total
    own = np.array([R[k] @ link.inertia @ R[k].T * mask[k] for k, link in enumerate(tree.links)])
    steiner = np.einsum("k,kij->ij", mass, np.sum(arm**2, axis=1)[:, None, None] * np.eye(3))
    steiner -= np.einsum("k,ki,kj->ij", mass, arm, arm)
    turned = R[near].T @ (own.sum(axis=0) + steiner) @ R[near]
    return turned * below.mass / total
