# SPDX-License-Identifier: Apache-2.0
"""The chain between two links of a robot, with the robot's own numbers.

What hangs beside the path counts with the link it hangs on, its joints at zero: a segment is all
that moves with it. What lies below the cut of the base's own sensor is not carried and left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from comcal.errors import UsageError
from comcal.robot.kinematics import Placements
from comcal.robot.model import Robot
from comcal.robot.soles import place_at_zero
from comcal.robot.tree import Array, JointType
from comcal.statics.stance import in_stance, stance_frame
from comcal.symbolic.algebra import Symbol
from comcal.symbolic.chain import Chain, planar_chain
from comcal.symbolic.spatial import SpatialChain, chain_from_axes

PARALLEL = 1e-9
"""How far the axes of a planar chain may be from P's y axis [1]."""


@dataclass(frozen=True)
class LinkPath:
    """The way from a base link to a tip link when all joints are zero.

    Parameters
    ----------
    names : tuple of str
        Of the joints on the way.
    prismatic : tuple of bool
    axes, points : array, shape (n, 3)
        Of the joints in the base frame: directions in which the far side turns; origins [m].
    links : tuple of str
        The base, and the first link that each joint carries.
    masses : array, shape (n + 1,)
        Of the base and of each segment [kg].
    base_com : array, shape (3,)
        CoM of the base in the base frame [m].
    """

    names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    axes: Array
    points: Array
    links: tuple[str, ...]
    masses: Array
    base_com: Array

    @property
    def is_planar(self) -> bool:
        """Whether all joints turn about the y axis of the base frame."""
        return not any(self.prismatic) and bool(
            np.all(np.abs(np.abs(self.axes[:, 1]) - 1.0) < PARALLEL)
        )


def default_ends(robot: Robot) -> tuple[str, str]:
    """Return the links between which to go when none are named.

    From the first foot to the root link; without feet, from the root link to the farthest one.
    """
    tree = robot.tree
    if robot.feet:
        return next(iter(robot.feet.values())).link, tree.links[0].name
    depth = np.zeros(len(tree.links), dtype=np.int_)
    for k, joint in enumerate(tree.joints, start=1):
        depth[k] = depth[tree.parents[k]] + joint.is_movable
    return tree.links[0].name, tree.links[int(np.argmax(depth))].name


def path_between(robot: Robot, base: str, tip: str) -> LinkPath:
    """Return the chain from link *base* to link *tip*.

    The base frame is P as it is when the robot stands on *base* alone if that is a foot, else the
    frame of the link.

    Raises
    ------
    UsageError
        If a link does not exist, the robot has no geometry, or no joint moves on the way.
    """
    tree = robot.tree
    if not tree.geometry_known:
        raise UsageError("a chain without URDF has no lengths to derive from", where=robot.name)
    for name in (base, tip):
        if name not in tree.link_index:
            raise UsageError(
                f"there is no link {name!r}",
                where=robot.name,
                next_step=f"links: {', '.join(tree.link_index)}",
            )
    at = _placed(robot, base)
    way = _way(robot, tree.link_index[base], tree.link_index[tip])
    segment = np.full(len(tree.links), -1, dtype=np.intp)
    segment[way[0]] = 0
    names: list[str] = []
    slides: list[bool] = []
    axes: list[Array] = []
    points: list[Array] = []
    links = [base]
    for a, b in pairwise(way):
        down = tree.parents[b] == a
        child = b if down else a
        joint = tree.joints[child - 1]
        if joint.is_movable:
            names.append(joint.name)
            slides.append(joint.kind is JointType.PRISMATIC)
            axes.append((1.0 if down else -1.0) * (at.R[0, child] @ joint.axis))
            points.append(at.p[0, child])
            links.append(tree.links[b].name)
        segment[b] = len(names)
    if not names:
        raise UsageError(f"no joint moves between {base!r} and {tip!r}", where=robot.name)
    _hang_on(robot, segment)
    foot = next((f for f in robot.feet.values() if f.link == base and f.sensor), None)
    if foot is not None and foot.sensor is not None:
        segment[robot.below_cut[foot.sensor]] = -1
    masses = np.array([tree.masses[segment == k].sum() for k in range(len(names) + 1)])
    standing = segment == 0
    moment = np.einsum("k,ki->i", tree.masses * standing, at.coms[0])
    return LinkPath(
        names=tuple(names),
        prismatic=tuple(slides),
        axes=np.array(axes),
        points=np.array(points),
        links=tuple(links),
        masses=masses,
        base_com=moment / masses[0] if masses[0] > 0 else np.zeros(3),
    )


def spatial_chain(path: LinkPath) -> SpatialChain:
    """Return the path as a spatial chain with numbers for lengths and masses."""
    offsets = np.diff(path.points, axis=0, prepend=np.zeros((1, 3)))
    return chain_from_axes(
        list(path.axes),
        list(offsets),
        path.prismatic,
        names=path.names,
        links=path.links,
        masses=path.masses.tolist(),
    )


def planar_values(path: LinkPath) -> tuple[Chain, dict[Symbol, float]]:
    """Return the symbols of a planar path, and the robot's numbers for them."""
    n = len(path.names)
    chain = planar_chain(n, offsets=True)
    steps = np.diff(path.points, axis=0)
    numbers: dict[str, npt.ArrayLike] = {
        "m": path.masses[1:],
        "L": steps[:, 2],
        "D": steps[:, 0],
        "m_u": path.masses[0],
        "r_u": path.base_com[0],
        "l_u": path.base_com[2],
        "U": path.points[0, 2],
        "A": path.points[0, 0],
    }
    values: dict[Symbol, float] = {}
    for q in chain.inputs:
        values |= dict(zip(q.symbols, np.ravel(numbers[q.name]).tolist(), strict=True))
    return chain, values


def _placed(robot: Robot, base: str) -> Placements:
    """Return the robot at zero, seen from the base frame."""
    at = place_at_zero(robot.tree)
    foot = next((name for name, f in robot.feet.items() if f.link == base), None)
    if foot is not None:
        return in_stance(*stance_frame(robot, foot, at), at)
    return in_stance(*at.link(base), at)


def _way(robot: Robot, base: int, tip: int) -> list[int]:
    """Return the links from *base* to *tip*, through their nearest common ancestor."""
    parents = robot.tree.parents

    def upward(k: int) -> list[int]:
        found = [k]
        while parents[found[-1]] >= 0:
            found.append(int(parents[found[-1]]))
        return found

    up, down = upward(base), upward(tip)
    common = next(k for k in up if k in down)
    return [*up[: up.index(common) + 1], *reversed(down[: down.index(common)])]


def _hang_on(robot: Robot, segment: npt.NDArray[np.intp]) -> None:
    """Give every link beside the way the segment of the link it hangs on."""
    parents = robot.tree.parents
    # Above the way first, from its highest link to the root; then all others, parents first.
    k = int(np.flatnonzero(segment >= 0)[0])
    while parents[k] >= 0:
        segment[parents[k]] = segment[k]
        k = int(parents[k])
    for k in range(1, len(segment)):
        if segment[k] < 0:
            segment[k] = segment[parents[k]]
