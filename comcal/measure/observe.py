# SPDX-License-Identifier: Apache-2.0
"""What somebody at the robot has to see while a pose is waited for, as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from comcal.measure.plan import DOUBLE, PlannedPose
from comcal.measure.reading import Tares, mean_of, reading_table
from comcal.measure.sole_hull import distance_inside
from comcal.measure.source import Block, SourceStatus
from comcal.measure.stance_load import stance_load
from comcal.measure.still import Motion, StillCriterion, newest_motion, window_length
from comcal.robot.model import Robot
from comcal.robot.tree import Array, JointType


@dataclass(frozen=True)
class JointWay:
    """Where a joint is and is wanted [rad] or [m]."""

    joint: str
    wanted: float
    measured: float
    is_angle: bool = True

    @property
    def way(self) -> float:
        """What is still to go, positive upwards."""
        return self.wanted - self.measured


@dataclass(frozen=True)
class Footprint:
    """Where the ground pushes, seen from above: x to the toes, y to the left [m].

    Parameters
    ----------
    cop : array, shape (2,)
    soles : tuple of array, each shape (n, 2)
        Corners of every standing sole.
    margin : float
        Distance of the CoP from the edge of the support polygon, negative outside.
    """

    cop: Array
    soles: tuple[Array, ...]
    margin: float


@dataclass(frozen=True)
class Observation:
    """One look at the robot.

    Parameters
    ----------
    pose : PlannedPose
        Wanted now.
    is_via : bool
        Whether that is the place beyond the pose from which it is approached.
    waited : float
        Since the pose was asked for [s], in the clock of the source.
    joints : tuple of JointWay
        Farthest from its place first.
    arrival : float
        How near is near enough [rad] or [m].
    motions : tuple of Motion
        What moves most first.
    reason : str
        Why the pose is not accepted yet.
    force, weight : float
        Normal force of what stands, and what it should carry [N]; NaN where not known.
    footprint : Footprint or None
    temperatures : mapping from sensor name to (float, float)
        Now, and the change since the recording started [deg C].
    status : SourceStatus or None
    """

    pose: PlannedPose
    is_via: bool
    waited: float
    joints: tuple[JointWay, ...]
    arrival: float
    motions: tuple[Motion, ...] = ()
    reason: str = ""
    force: float = float("nan")
    weight: float = float("nan")
    footprint: Footprint | None = None
    temperatures: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )
    status: SourceStatus | None = None


@dataclass(frozen=True)
class Look:
    """What an observation is made of besides the newest samples; see :class:`Observation`."""

    pose: PlannedPose
    is_via: bool
    waited: float
    reason: str
    status: SourceStatus | None = None
    tares: Tares = field(default_factory=dict[str, tuple[Array, Array]])
    temperatures: Mapping[str, float] = field(default_factory=dict[str, float])


def observe(look: Look, recent: Block, robot: Robot, criterion: StillCriterion) -> Observation:
    """Return what there is to see.

    Parameters
    ----------
    look : Look
        ``look.temperatures`` are those at the start.
    recent : Block
        The newest samples; the last window of them is averaged.
    robot : Robot
    criterion : StillCriterion
    """
    support = look.pose.support
    length = window_length(recent.t, criterion) or recent.t.size
    newest = _last(recent, length)
    force, weight, footprint = _standing(newest, robot, support, look.tares)
    return Observation(
        pose=look.pose,
        is_via=look.is_via,
        waited=look.waited,
        joints=_joints(robot, look.pose.q, mean_of(newest.q)),
        arrival=criterion.arrival,
        motions=newest_motion(recent, robot, support, criterion),
        reason=look.reason,
        force=force,
        weight=weight,
        footprint=footprint,
        temperatures={
            name: (now, now - look.temperatures.get(name, now))
            for name, now in temperatures_of(newest).items()
        },
        status=look.status,
    )


def temperatures_of(block: Block) -> dict[str, float]:
    """Return the mean temperature of every sensor that has a thermometer [deg C]."""
    found = {
        name: float(mean_of(values[:, None])[0])
        for name, values in (block.temperatures or {}).items()
    }
    return {name: value for name, value in found.items() if np.isfinite(value)}


def _last(block: Block, length: int) -> Block:
    return Block(
        t=block.t[-length:],
        q=block.q[-length:],
        wrenches={name: w[-length:] for name, w in block.wrenches.items()},
        temperatures={n: v[-length:] for n, v in (block.temperatures or {}).items()},
    )


def _joints(robot: Robot, wanted: Array, measured: Array) -> tuple[JointWay, ...]:
    tree = robot.tree
    ways = [
        JointWay(name, w, m, tree.joints[tree.joint_index[name]].kind is not JointType.PRISMATIC)
        for name, w, m in zip(tree.joint_names, wanted.tolist(), measured.tolist(), strict=True)
    ]
    return tuple(sorted(ways, key=lambda way: -np.nan_to_num(abs(way.way), nan=np.inf)))


def _standing(
    block: Block, robot: Robot, support: str, tares: Tares
) -> tuple[float, float, Footprint | None]:
    """Return force, weight and footprint; NaN and None where nothing measured stands."""
    unknown = float("nan"), float("nan"), None
    if not robot.tree.geometry_known or not robot.feet or not robot.tree.total_mass > 0.0:
        return unknown
    table = reading_table(block, robot, support, tares)
    if not np.isfinite(table.q).all():
        return unknown
    load = stance_load(table, robot)
    weight = float(load.mass[0]) * robot.gravity
    if not np.isfinite(weight):
        return unknown
    force = float(load.total_force()[0, 2])
    corners = load.corners[0]
    if corners is None:
        return force, weight, None
    cop = load.line_of_gravity(np.full(1, corners[:, 2].mean()))[0]
    if not np.isfinite(cop).all():
        return force, weight, None
    feet = [f for f in robot.feet.values() if support in (DOUBLE, f.name)]
    ends = np.cumsum([0 if f.sole is None else len(f.sole) for f in feet])
    soles = tuple(np.split(corners[:, :2], ends[:-1]))
    return force, weight, Footprint(cop, soles, distance_inside(cop, corners[:, :2]))
