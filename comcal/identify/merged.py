# SPDX-License-Identifier: Apache-2.0
r"""What no static pose of a tree can tell apart, joint by joint.

About a turning joint, first moment along the axis belongs to the child as well as to the parent:
:math:`h_c + a`, :math:`h_p - a` look the same. So does, where masses are free, a mass at the
joint's origin taken from one and given to the other. Along a sliding joint both have
one rotation, and all three components of the moment may move. There are no others: the rank of
static data is 1 + 3 + 2 n for n turning joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comcal.identify.unknowns import Unknowns, rigid_parts
from comcal.robot.kinematics import place_links
from comcal.robot.tree import Array, JointType

CLEAR = 1e-9
"""Parts of a direction below this share of its largest are rounding."""


@dataclass(frozen=True)
class Merged:
    """A direction of theta that no static pose sees, whatever its slope.

    Parameters
    ----------
    direction : array, shape (size,)
    joints : tuple of str
        Across which the parts are merged.
    why : str
        The reason, in words.
    """

    direction: Array
    joints: tuple[str, ...]
    why: str


def merged_directions(unknowns: Unknowns) -> tuple[Merged, ...]:
    """Return a basis of what statics cannot tell apart among the free unknowns.

    Parameters
    ----------
    unknowns : Unknowns

    Returns
    -------
    tuple of Merged
        In tree order. Moves that would have to change a body that is not free are none: what is
        given tells its neighbours apart.
    """
    columns, names = _moves(unknowns)
    if not names:
        return ()
    inside, outside = columns[: unknowns.size], columns[unknowns.size :]
    found: list[Merged] = []
    alone = ~np.any(np.abs(outside) > CLEAR, axis=0)
    for k in np.flatnonzero(alone):
        found.append(_merged(unknowns, inside[:, k], (names[k],)))
    tied = np.flatnonzero(~alone)
    if tied.size:
        _, values, Vt = np.linalg.svd(outside[:, tied])
        null = Vt[int(np.sum(values > CLEAR * max(values[0], 1.0))) :]
        for z in null:
            parts = tuple(names[k] for k, c in zip(tied, z, strict=True) if abs(c) > CLEAR)
            found.append(_merged(unknowns, inside[:, tied] @ z, parts))
    return tuple(found)


def _moves(unknowns: Unknowns) -> tuple[Array, list[str]]:
    """Return every elementary move as a column: free unknowns first, then those of given bodies."""
    robot = unknowns.robot
    tree, bodies = robot.tree, rigid_parts(robot)
    leader = {int(bodies[k]): k for k in unknowns.links}
    given = [int(b) for b in np.unique(bodies) if int(b) not in leader]
    at = place_links(tree, np.zeros((1, len(tree.joint_names))))
    R, p = at.R[0], at.p[0]
    columns: list[Array] = []
    names: list[str] = []
    for k, joint in enumerate(tree.joints, start=1):
        if not joint.is_movable:
            continue
        pair = [(int(bodies[k]), 1.0), (int(bodies[tree.parents[k]]), -1.0)]
        moves = [(0.0, R[k] @ joint.axis)]
        if joint.kind is JointType.PRISMATIC:
            moves = [(0.0, axis) for axis in np.eye(3)]
        elif unknowns.free_masses:
            moves.append((1.0, np.zeros(3)))
        for mass, moment in moves:
            column = np.zeros(unknowns.size + 4 * len(given))
            for body, sign in pair:
                link = leader.get(body, body)
                # A mass at the joint's origin has a moment about the origin of the body's frame.
                h = R[link].T @ (moment + mass * (p[k] - p[link]))
                if body in leader:
                    start = unknowns.column(link)
                    if start is not None:
                        column[start : start + 3] += sign * h
                    mass_column = unknowns.mass_column(link)
                    if mass_column is not None:
                        column[mass_column] += sign * mass
                else:
                    start = unknowns.size + 4 * given.index(body)
                    column[start] += sign * mass
                    column[start + 1 : start + 4] += sign * h
            columns.append(column)
            names.append(joint.name)
    return np.array(columns).T.reshape(unknowns.size + 4 * len(given), -1), names


def _merged(unknowns: Unknowns, direction: Array, joints: tuple[str, ...]) -> Merged:
    tree = unknowns.robot.tree
    if len(set(joints)) > 1:
        why = f"merged across {', '.join(dict.fromkeys(joints))}"
        return Merged(direction, joints, why)
    joint = tree.joints[tree.joint_index[joints[0]]]
    bodies = rigid_parts(unknowns.robot)
    names = {int(bodies[k]): tree.links[k].name for k in unknowns.links}
    child = names.get(int(bodies[tree.link_index[joint.child]]), joint.child)
    parent = names.get(int(bodies[tree.link_index[joint.parent]]), joint.parent)
    along = "" if joint.kind is JointType.PRISMATIC else "along the axis of "
    if any(direction[: unknowns.n_masses]) and unknowns.free_masses:
        along = "as a mass on the axis of "
    along = f"{along}{joint.name}, " if along else f"across {joint.name}, "
    return Merged(direction, joints, f"{along}{child} is merged into {parent}")
